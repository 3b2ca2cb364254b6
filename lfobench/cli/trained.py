"""The policies that runs left: which record is meant, and what its policy does from the fixed starts."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

from lfobench.cli.inputs import warn
from lfobench.contract.record import Record, Warning
from lfobench.contract.scene import Scene
from lfobench.contract.suite import Suite, Task
from lfobench.engine.policy import TrainedPolicy, load_policy
from lfobench.engine.trace import Trace, trace
from lfobench.errors import UserError
from lfobench.plan.names import parse_seeds
from lfobench.registry import load_suite, suite_names
from lfobench.store.folder import RecordFolder

MOST_STARTS = 100
"""In one picture; each is an episode."""


def scene_of(suite: Suite) -> Callable[[str], Scene]:
    """What a top view of the suite's environments shows.

    Raises:
        UserError: it has none.
    """
    if suite.scene is None:
        raise UserError(f"Suite '{suite.name}' has no scene: there is nothing to be seen from above.")
    return suite.scene


def suite_of(record: Record, given: str | None) -> Suite:
    """The suite that a record is of: the one that was given by name or path, or else the registered one of its name.

    Raises:
        UserError: there is none.
    """
    if given is None and record.labels.suite not in suite_names():
        raise UserError(
            f"The records are of suite '{record.labels.suite}', which is not registered.",
            "Give the path of its file with --suite.",
        )
    return load_suite(given or record.labels.suite)


def of_seed(records: Sequence[Record], seed: int) -> list[Record]:
    """Those of one seed.

    Raises:
        UserError: there is none.
    """
    if not records:
        raise UserError("There are no runs to draw.", "Run 'lfobench run' first, or name another folder with --out.")
    found = [record for record in records if record.seed == seed]
    if not found:
        seeds = ", ".join(map(str, sorted({record.seed for record in records})))
        raise UserError(f"None of the runs has seed {seed}.", f"Name one of {seeds} with --seed.")
    return found


def outcomes_of(records: Iterable[Record]) -> set[str]:
    """Every way in which an episode of these runs has ended."""
    evaluations = [each for record in records for each in (*record.evaluations, record.further) if each is not None]
    return {outcome for each in evaluations for outcome in each.outcomes or ()}


def starts_of(text: str | None, record: Record, most: int = MOST_STARTS) -> list[int]:
    """The fixed starts by number, e.g. ``0-3``; where none are named, those of the record's evaluations.

    Raises:
        UserError: no such numbers, or too many.
    """
    if text is None:
        return list(range(int(record.identity["protocol"]["evaluation_episodes"])))
    try:
        starts = parse_seeds(text)
    except UserError as error:
        raise UserError(
            f"'{text}' is not a list of episodes.", "Write numbers and rising ranges: 0-3 or 0,2."
        ) from error
    if len(starts) > most:
        raise UserError(f"'{text}' are {len(starts):,} episodes.", f"Name at most {most}.")
    return starts


def policy_of(out: Path, record: Record) -> TrainedPolicy:
    """The policy that a record's run left below `out`.

    Raises:
        UserError: its file is missing or damaged.
    """
    return load_policy(RecordFolder(out), record)


def traces_of(out: Path, record: Record, task: Task, starts: Sequence[int]) -> list[Trace]:
    """Episodes of a record's policy; a warning is printed where they end otherwise than the record says.

    Raises:
        UserError: the policy is missing or damaged, or its environment cannot be traced.
    """
    traces = trace(policy_of(out, record).act, task, starts)
    last = [*record.evaluations[-1:], *([record.further] if record.further else [])]
    told = [outcome for evaluation in last for outcome in evaluation.outcomes or ()]
    otherwise = [each for each in traces if each.start < len(told) and told[each.start] != each.outcome]
    if otherwise:
        ends = ", ".join(f"start {each.start} {each.outcome} (not {told[each.start]})" for each in otherwise)
        what = f"{record.method} on {record.task}, seed {record.seed}, now ends otherwise than its record says: {ends}."
        warn([Warning(what=what, remedy="Another machine, or another version of a library, rounds otherwise.")])
    return traces
