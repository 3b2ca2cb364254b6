"""A comparison as every exporter draws it: the cells, their verdicts, and what they can show at all."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from lfobench.contract.record import Warning
from lfobench.contract.statistic import Statistic
from lfobench.errors import UserError
from lfobench.render.highlight_note import TESTS, unit
from lfobench.render.pairing import CellName, Pairing, name_of
from lfobench.stats.contrast import Comparison, Contrast, Outcome, best_p, contrast, scores_compared
from lfobench.stats.highlight import Rule

Verdict: TypeAlias = Outcome | Literal["identical"]

VERDICTS: tuple[Verdict, ...] = ("worse", "undecided", "better", "untested", "identical")
"""In the order of the output: what asks for a look comes first."""

_UNJUDGED = "They cannot be judged, and do not count for the exit code."


@dataclass(frozen=True)
class Compared:
    """A comparison with its outcome. Identical cells are not in `contrast`: they take no part in the correction."""

    pairing: Pairing
    contrast: Contrast[CellName]
    rule: Rule
    statistic: Statistic

    @property
    def regressed(self) -> bool:
        """Whether the second folder is worse on any cell; of two methods, one may well be."""
        return self.pairing.kind == "folders" and bool(self.contrast.having("worse"))

    def verdict(self, cell: CellName) -> Verdict:
        """What is said of a cell."""
        return "identical" if self.pairing.pairs[cell].identical else self.contrast.cells[cell].outcome

    def having(self, verdict: Verdict) -> list[CellName]:
        """The cells of one verdict."""
        return [cell for cell in self.pairing.pairs if self.verdict(cell) == verdict]


def compare(pairing: Pairing, rule: Rule, statistic: Statistic) -> Compared:
    """Judge the subject of a pairing by a rule, whose scope plays no part.

    Raises:
        UserError: the test cannot be made with these records, or α is 0 or 1.
    """
    if not 0.0 < rule.alpha < 1.0:
        raise UserError(f"At level {rule.alpha:g} every verdict is settled beforehand.", "Use --alpha 0.05.")
    try:
        outcome = contrast({cell: pair.samples for cell, pair in pairing.pairs.items() if not pair.identical}, rule)
    except ValueError as error:
        raise UserError(f"The test cannot be made: {error}", "Choose another with --test, e.g. welch.") from error
    return Compared(pairing, outcome, rule, statistic)


def warnings_of(compared: Compared) -> list[Warning]:
    """What a reader of the exit code alone must not miss."""
    pairing, warnings = compared.pairing, []
    if pairing.kind == "folders" and pairing.only_reference:
        gone = ", ".join(
            name_of(cell) + (" (every seed crashed)" if cell in pairing.crashed else "")
            for cell in pairing.only_reference
        )
        warnings.append(
            Warning(what=f"{pairing.subject.name} lacks cells of {pairing.reference.name}: {gone}.", remedy=_UNJUDGED)
        )
    if blind := blind_because(compared):
        warnings.append(Warning(what=f"This comparison cannot find anything: {blind}.", remedy="Use more, or --test."))
    return warnings


def summary(compared: Compared) -> str:
    """``dilo against smodice: better on 1 task, worse on 0, undecided on 1``; a regression gate says worse first."""
    pairing = compared.pairing
    words: list[Verdict] = (
        ["better", "worse", "undecided"] if pairing.kind == "methods" else ["worse", "undecided", "better"]
    )
    parts: list[str] = []
    for verdict in [*words, *(other for other in VERDICTS if other not in words and compared.having(other))]:
        count = len(compared.having(verdict))
        counted = f"{count}" if parts else f"{count} {pairing.unit}{'' if count == 1 else 's'}"
        parts.append(f"{verdict}{'' if verdict == 'identical' else ' on'} {counted}")
    return f"{pairing.subject.heading} against {pairing.reference.heading}: {', '.join(parts)}"


def blind_because(compared: Compared) -> str | None:
    """Why no scores whatever could have led to a verdict; None where some could, or where all is identical."""
    judged, rule = list(compared.contrast.cells.values()), compared.rule
    if not judged or any(cell.reachable for cell in judged):
        return None
    units = f"{unit(rule.test)}s"
    tested = [cell for cell in judged if cell.p is not None]
    if not tested:
        return f"no cell has two {units} on both sides"
    largest = max(tested, key=lambda cell: min(_sizes(cell, rule)))
    sizes = " against ".join(map(str, _sizes(largest, rule)))
    times = f", times {len(tested)} under Holm" if rule.correction == "holm" and len(tested) > 1 else ""
    return f"with {sizes} {units}, {TESTS[rule.test]} gives at best p = {best_p(largest, rule.test):.2g}{times}"


def _sizes(cell: Comparison, rule: Rule) -> tuple[int, int]:
    return scores_compared(rule.test, cell.subject), scores_compared(rule.test, cell.reference)
