"""What went wrong or wants attention: crashed runs, diverged runs, warnings of records and of the folder."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from lfobench.contract.failure import Failure
from lfobench.contract.record import Record, Warning
from lfobench.render.markup import Markup, element, joined, name_of


def problems_section(records: Sequence[Record], failures: Sequence[Failure], warnings: Sequence[Warning]) -> Markup:
    """Failures with their tracebacks, divergences, warnings; a plain sentence where there are none."""
    diverged = [record for record in records if record.status == "diverged"]
    concerned: dict[tuple[str, str], list[str]] = {}
    for warning in warnings:
        concerned.setdefault((warning.what, warning.remedy), [])
    for record in records:
        for warning in record.warnings:
            concerned.setdefault((warning.what, warning.remedy), []).append(_place(record))
    parts = [_failures(failures), _diverged(diverged), _warnings(concerned)]
    nothing = element("p", "No run failed, none diverged, and no record carries a warning.")
    return element(
        "section",
        element("h2", "Failures and warnings"),
        joined(part for part in parts if part) or nothing,
        id="problems",
    )


def _failures(failures: Sequence[Failure]) -> Markup:
    if not failures:
        return Markup("")
    entries = [
        element(
            "details",
            element("summary", name_of(_place(failure)), ": ", failure.error),
            element("pre", "\n".join(failure.traceback) or "No traceback was kept.", tabindex="0"),
        )
        for failure in failures
    ]
    return joined(
        [
            element("h3", f"Failed runs ({len(failures)})"),
            element("p", "They have no score and are in no mean; running the same command tries them again."),
            *entries,
        ]
    )


def _diverged(records: Sequence[Record]) -> Markup:
    if not records:
        return Markup("")
    entries = [
        element(
            "li",
            name_of(_place(record)),
            f": at step {record.diverged_at:,}" if record.diverged_at is not None else "",
        )
        for record in records
    ]
    return joined(
        [
            element("h3", f"Diverged runs ({len(records)})"),
            element("p", "They count with score 0."),
            element("ul", *entries),
        ]
    )


def _warnings(concerned: Mapping[tuple[str, str], Sequence[str]]) -> Markup:
    if not concerned:
        return Markup("")
    entries = [
        element("li", f"{what} {remedy}", *([" Runs: ", name_of("; ".join(runs)), "."] if runs else []))
        for (what, remedy), runs in concerned.items()
    ]
    return joined([element("h3", f"Warnings ({len(entries)})"), element("ul", *entries)])


def _place(run: Record | Failure) -> str:
    return f"{run.method} on {run.task}, seed {run.seed}"
