"""The trajectory doctor: what is wrong, odd or merely good to know about a file's episodes."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterator

import numpy as np

from lfobench.contract.diagnosis import Diagnosis, Finding, Mode, Severity
from lfobench.contract.episodes import BoolArray, Episodes, FloatArray, IntArray
from lfobench.data import boundaries
from lfobench.data.readers.reading import Reading
from lfobench.words import counted


def diagnose(reading: Reading, horizon: int | None = None, shortened: bool = False) -> Diagnosis:
    """Examine what a reader made of a file.

    Args:
        reading: the file's episodes.
        horizon: the environment's, where it is known.
        shortened: whether the last episode may have been cut to a number of rows, so that where it ends says nothing.
    """
    episodes = reading.episodes
    order: list[Severity] = ["problem", "caution", "note"]
    found = [*_values(reading), *_ends(reading, horizon, shortened), *_repetitions(episodes)]
    return Diagnosis(
        format=reading.format,
        observation=episodes.observations.shape[1],
        action=episodes.actions.shape[1],
        lengths=tuple(episodes.lengths.tolist()),
        returns=tuple(episodes.returns().tolist()) if np.isfinite(episodes.rewards).all() else (),
        terminations=tuple(episodes.terminated.tolist()),
        timeouts=reading.timeouts,
        horizon=horizon,
        findings=tuple(sorted(found, key=lambda finding: order.index(finding.severity))),
        modes=tuple(_modes(episodes, reading.timeouts)),
    )


def diagnose_part(episodes: Episodes, horizon: int) -> Diagnosis:
    """Examine a part of a task as the cache holds it, of which a protocol may read no more than the first rows."""
    known = not episodes.unknown_ends.any()
    rewarded = bool(np.isfinite(episodes.rewards).all())
    return diagnose(Reading(episodes, "cached", rewards=rewarded, ends_known=known), horizon, shortened=True)


def rows_inside(expert: Episodes, offline: Episodes) -> int:
    """Expert rows (observation and action) that the offline part holds too, to the last bit."""
    return int(np.isin(_rows_as_bytes(expert), _rows_as_bytes(offline)).sum())


def _values(reading: Reading) -> Iterator[Finding]:
    episodes = reading.episodes
    fields: dict[str, tuple[FloatArray, BoolArray]] = {
        "observations": (episodes.observations, episodes.known),
        "actions": (episodes.actions, np.ones(len(episodes.actions), np.bool_)),
    }
    if reading.rewards:
        fields["rewards"] = (episodes.rewards[:, None], np.ones(len(episodes.rewards), np.bool_))
    bad = {field: int((~np.isfinite(values).all(axis=1) & counts).sum()) for field, (values, counts) in fields.items()}
    for field, count in (bad | {"next_observations": len(reading.not_finite)}).items():
        if count:
            text = f"{counted(count, 'row')} of {field} {'has' if count == 1 else 'have'} a NaN or an infinity."
            yield Finding("problem", f"{field}-not-finite", count, text)
    sizes = np.abs(episodes.actions, where=np.isfinite(episodes.actions), out=np.zeros_like(episodes.actions))
    if count := int((sizes.max(axis=1) > 1.0).sum()):
        text = f"{counted(count, 'action leaves', 'actions leave')} [-1, 1], the farthest to {sizes.max():.3g}; "
        text += "environments clip them, policies cannot."
        yield Finding("caution", "actions-out-of-range", count, text)
    for field in ("observations", "actions"):
        values, counts = fields[field]
        # A column with a NaN is none: NaN is not equal to itself.
        constant = np.flatnonzero((values[counts] == values[0]).all(axis=0)).tolist()
        if constant:
            changes = f"{'never changes' if len(constant) == 1 else 'never change'}: {_listed(constant)}."
            text = f"{counted(len(constant), 'column')} of {field} {changes}"
            yield Finding("note", f"{field}-constant", len(constant), text)
    if not reading.rewards:
        yield Finding("note", "no-rewards", 1, "There are no rewards, so no returns; no method reads them.")


def _ends(reading: Reading, horizon: int | None, shortened: bool) -> Iterator[Finding]:
    lengths = reading.episodes.lengths
    if gaps := len(reading.gaps):
        text = f"{counted(gaps, 'row leads', 'rows lead')} to another observation than the following row has, and no "
        text += f"flag ends an episode there ({_first(reading.gaps)}); the reader does."
        yield Finding("caution", "gaps", gaps, text)
    if misplaced := len(reading.misplaced):
        stand = counted(misplaced, "time-out stands at a row", "time-outs stand at rows")
        text = f"{stand} whose next observation is the following row's ({_first(reading.misplaced)}): misplaced, "
        text += "perhaps by one row."
        yield Finding("caution", "misplaced-timeouts", misplaced, text)
    if reading.unfinished:
        yield Finding("note", "unfinished", 1, "The last episode has no end; it is read as cut by time.")
    if count := reading.both_flags:
        text = f"{counted(count, 'episode is', 'episodes are')} both terminated and timed out."
        yield Finding("caution", "both-flags", count, text)
    if not reading.ends_known:
        text = "The observation that an episode ends in is not in the file; steps that lead there have no successor."
        yield Finding("note", "ends-unknown", len(lengths), text)
    if not reading.timeouts:
        text = "The file does not say which episodes time ended."
        yield Finding("caution" if reading.format == "d4rl" else "note", "no-timeouts", len(lengths), text)
    if horizon is not None:
        yield from _against_horizon(reading, horizon, shortened)


def _against_horizon(reading: Reading, horizon: int, shortened: bool) -> Iterator[Finding]:
    episodes, lengths = reading.episodes, reading.episodes.lengths
    steps = counted(horizon, "step")
    if count := int((lengths > horizon).sum()):
        longer = counted(count, "episode is longer", "episodes are longer")
        text = f"{longer} than the horizon of {steps}: time-outs are missing or misplaced."
        yield Finding("caution", "longer-than-horizon", count, text)
    flagged = ~episodes.terminated & reading.timeouts
    flagged[np.isin(np.cumsum(lengths) - 1, reading.gaps)] = False
    if reading.unfinished or shortened:
        flagged[-1] = False
    if count := int((flagged & (lengths < horizon)).sum()):
        text = f"{counted(count, 'episode was', 'episodes were')} cut by time before the horizon of {steps}."
        yield Finding("caution", "early-timeouts", count, text)
    if count := int((episodes.terminated & (lengths == horizon)).sum()):
        marked = "is marked as terminated: time ended it" if count == 1 else "are marked as terminated: time ended them"
        text = f"{counted(count, 'episode')} of exactly {steps} {marked}, it seems."
        yield Finding("caution", "terminal-at-horizon", count, text)


def _repetitions(episodes: Episodes) -> Iterator[Finding]:
    first, stop = episodes.first_transition, episodes.first_transition + episodes.lengths
    marks = Counter(
        hashlib.sha256(
            episodes.observations[start : start + length].tobytes() + episodes.actions[begin:end].tobytes()
        ).digest()
        for start, length, begin, end in zip(episodes.first_observation, episodes.lengths, first, stop, strict=True)
    )
    if repeated := sum(count - 1 for count in marks.values()):
        text = f"{counted(repeated, 'episode repeats', 'episodes repeat')} an earlier one, to the last bit."
        yield Finding("caution", "duplicated-episodes", repeated, text)


def _modes(episodes: Episodes, timeouts: bool) -> Iterator[Mode]:
    count, terminated = len(episodes.lengths), int(episodes.terminated.sum())
    pairs = boundaries.released_transitions(episodes)
    final = int(episodes.terminated[-1])
    reason = "time ended" if timeouts else "are not terminated"
    yield Mode(
        "released pairs",
        len(pairs),
        {f"last steps of episodes that {reason}": count - terminated, "last row of the file": final},
        {"lead into the next episode": int(pairs.terminated.sum())},
    )
    triples = boundaries.released_triples(pairs)
    second = triples.second_next_observation
    assert second is not None
    ended = int(pairs.terminated[:-1].sum())
    yield Mode(
        "released triples",
        len(triples),
        {
            "dropped as pairs": episodes.transitions - len(pairs),
            "pairs of terminal steps": ended,
            "pairs that the next one does not continue": len(pairs) - ended - len(triples),
        },
        {"lead into the next episode": int((second != triples.observation + 2).sum())},
    )
    exact = boundaries.exact_transitions(episodes)
    yield Mode("exact pairs", len(exact), {"unknown next observations": episodes.transitions - len(exact)}, {})
    within = boundaries.triples_within(episodes)
    dropped = {"last steps of episodes": count, "unknown s''": episodes.transitions - count - len(within)}
    yield Mode("exact triples", len(within), dropped, {})


def _rows_as_bytes(episodes: Episodes) -> np.ndarray:  # type: ignore[type-arg]
    """``[N]`` one opaque value per row."""
    rows = np.hstack((episodes.observations[episodes.observation_of_transition], episodes.actions))
    return np.ascontiguousarray(rows).view(np.dtype((np.void, rows.shape[1] * rows.itemsize)))[:, 0]


def _first(rows: IntArray) -> str:
    return f"{'row' if len(rows) == 1 else 'the first is row'} {int(rows[0]):,}"


def _listed(columns: list[int]) -> str:
    """``3, 5, 27 to 110``."""
    runs: list[list[int]] = []
    for column in columns:
        if runs and column == runs[-1][-1] + 1:
            runs[-1].append(column)
        else:
            runs.append([column])
    return ", ".join(str(run[0]) if len(run) == 1 else f"{run[0]} to {run[-1]}" for run in runs)
