"""The trajectory doctor: problems, cautions and notes about a file's episodes."""

from __future__ import annotations

import hashlib
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from lfobench.contract.episodes import BoolArray, Episodes, FloatArray, IntArray
from lfobench.data import boundaries
from lfobench.data.readers.hdf5 import enumerated
from lfobench.data.readers.reading import Reading, not_finite
from lfobench.text import counted, shown

Severity = Literal["problem", "caution", "note"]
"""A problem keeps a file from being used; a caution changes what is learnt or known from it; a note does neither."""


@dataclass(frozen=True)
class Finding:
    """One thing that was found.

    Attributes:
        severity: how much it matters.
        code: identifier for scripts.
        count: number of cases.
        text: a sentence.
    """

    severity: Severity
    code: str
    count: int
    text: str


@dataclass(frozen=True)
class Mode:
    """Rows under one boundary rule.

    Attributes:
        name: e.g. ``released triples``.
        kept: number of rows that exist.
        dropped: reason to number of rows that do not.
        odd: peculiarity to number of kept rows that have it.
    """

    name: str
    kept: int
    dropped: dict[str, int]
    odd: dict[str, int]


@dataclass(frozen=True)
class Diagnosis:
    """A file, examined.

    Attributes:
        format: ``d4rl``, ``minari``, ``robomimic``, ``npz`` or ``lerobot``; ``cached`` of a part that was read or made
            before.
        observation: columns of an observation.
        action: columns of an action.
        lengths: steps of every episode.
        returns: of every episode; empty where rewards are missing or not finite.
        terminations: of every episode, whether it ended by itself.
        timeouts: whether the file says which episodes time ended; where it does not, those that did not end by
            themselves may have ended in any way.
        horizon: steps after which the environment cuts an episode; None where that is not known.
        findings: most severe first.
        modes: rows under every boundary rule.
    """

    format: str
    observation: int
    action: int
    lengths: tuple[int, ...]
    returns: tuple[float, ...]
    terminations: tuple[bool, ...]
    timeouts: bool
    horizon: int | None
    findings: tuple[Finding, ...]
    modes: tuple[Mode, ...]

    @property
    def terminated(self) -> int:
        """Episodes that ended by themselves."""
        return sum(self.terminations)

    @property
    def usable(self) -> bool:
        """True if the file can be trained on: no finding is a problem."""
        return all(finding.severity != "problem" for finding in self.findings)


FEWEST_TRIPLES = 2
"""Triples of a part, at the least; the authors' buffer never samples its last row."""
FEW_ROWS = 5
"""Rows that are listed one by one, at the most."""


def diagnose(reading: Reading, horizon: int | None = None, shortened: bool = False) -> Diagnosis:
    """Diagnosis of a file as read.

    Args:
        reading: the file's episodes.
        horizon: the environment's, where it is known.
        shortened: whether the last episode may have been cut to a number of rows, so that where it ends says nothing.
    """
    episodes = reading.episodes
    order: list[Severity] = ["problem", "caution", "note"]
    found = [
        *_amount(reading),
        *_values(reading),
        *_choice(reading),
        *_ends(reading, horizon, shortened),
        *doubtful_ends(episodes),
        *_repetitions(episodes),
    ]
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
    """Diagnosis of a cached part, of which a protocol may read the first rows only."""
    known = not episodes.unknown_ends.any()
    rewarded = bool(np.isfinite(episodes.rewards).all())
    return diagnose(Reading(episodes, "cached", rewards=rewarded, ends_known=known), horizon, shortened=True)


def too_short(episodes: Episodes) -> str:
    """Reason why nothing can be learned from episodes, as a clause; empty where something can."""
    triples = boundaries.released_triples(boundaries.released_transitions(episodes))
    if len(triples) >= FEWEST_TRIPLES:
        return ""
    have = "has" if len(triples) == 1 else "have"
    return f"of its {counted(episodes.transitions, 'row')}, {len(triples)} {have} two successors in their episode"


def doubtful_ends(episodes: Episodes) -> Iterator[Finding]:
    """Last observations of episodes that do not look like where the last action led.

    One that repeats, or is zero, counts where the observation before it does not.
    """
    observations, last = episodes.observations, episodes.last_observation
    # A terminal that leads to where the next episode starts.
    leads_on = np.flatnonzero(
        (observations[last[:-1]] == observations[episodes.first_observation[1:]]).all(axis=1) & episodes.terminated[:-1]
    )
    if len(leads_on):
        rows = np.cumsum(episodes.lengths)[leads_on] - 1
        terminals = counted(len(rows), "terminal leads", "terminals lead")
        text = f"{terminals} into the next episode ({_rows(rows)}): the next observation there is the following row's, "
        text += "as in what D4RL's Q-learning view gives, and the true last observation is not in the file."
        yield Finding("caution", "terminals-lead-on", len(rows), text)
    long = episodes.lengths > 1
    before = last - 1
    repeats = (observations[last] == observations[before]).all(axis=1)
    repeats[long] &= ~(observations[before[long]] == observations[before[long] - 1]).all(axis=1)
    if count := int(repeats.sum()):
        steps = counted(count, "last step leads to where it", "last steps lead to where they")
        text = f"{steps} began: the observation is repeated in place of the one that ends the episode."
        yield Finding("caution", "last-repeats", count, text)
    zero = ~observations[last].any(axis=1) & observations[before].any(axis=1)
    if count := int(zero.sum()):
        steps = counted(count, "last step leads", "last steps lead")
        text = f"{steps} to an observation of zeros, which stands for an unknown one, it seems."
        yield Finding("caution", "last-zero", count, text)


def rows_inside(expert: Episodes, offline: Episodes) -> int:
    """Expert rows (observation and action) that the offline part holds too, to the last bit."""
    return int(np.isin(_rows_as_bytes(expert), _rows_as_bytes(offline)).sum())


def _amount(reading: Reading) -> Iterator[Finding]:
    episodes = reading.episodes
    if why := too_short(episodes):
        yield Finding("problem", "too-short", episodes.transitions, f"Nothing can be learned from it: {why}.")
    for name, declared, found in (
        ("episode", reading.declared_episodes, len(episodes.lengths)),
        ("step", reading.declared_steps, episodes.transitions),
    ):
        if declared is not None and declared != found:
            text = f"The file says that it has {counted(declared, name)}, and has {found:,}."
            yield Finding("caution", f"declared-{name}s", abs(declared - found), text)


def _choice(reading: Reading) -> Iterator[Finding]:
    """Parts of the file that are left out."""
    read, left_out = reading.keys, reading.left_out
    if left_out:
        whole = sum(read.values()) + sum(left_out.values())
        text = f"An observation is {_widths(read)}: {sum(read.values())} of {counted(whole, 'column')}. "
        text += f"Left out: {_widths(left_out)}."
        text += "" if reading.chosen else " Choose with keys=A+B in --source, or --keys of the doctor."
        yield Finding("note" if reading.chosen else "caution", "keys-left-out", len(left_out), text)
    if reading.not_read:
        yield Finding("note", "not-read", len(reading.not_read), f"Not read: {enumerated(reading.not_read)}.")
    for field, kinds in reading.kinds.items():
        each = ", ".join(f"{kind} in {counted(count, 'array')}" for kind, count in kinds.items())
        text = f"Number types of {shown(field)} differ: {each}. All are read as float32."
        yield Finding("caution", "number-types", len(kinds), text)


def _values(reading: Reading) -> Iterator[Finding]:
    episodes = reading.episodes
    for field, rows in not_finite(reading).items():
        if count := len(rows):
            text = f"{counted(count, 'row')} of {field} {'has' if count == 1 else 'have'} a NaN or an infinity."
            yield Finding("problem", f"{field}-not-finite", count, text)
    sizes = np.abs(episodes.actions, where=np.isfinite(episodes.actions), out=np.zeros_like(episodes.actions))
    if count := int((sizes.max(axis=1) > 1.0).sum()):
        text = f"{counted(count, 'action leaves', 'actions leave')} [-1, 1], the farthest to {sizes.max():.3g}; "
        text += "environments clip them, policies cannot."
        yield Finding("caution", "actions-out-of-range", count, text)
    fields: dict[str, tuple[FloatArray, BoolArray]] = {
        "observations": (episodes.observations, episodes.known),
        "actions": (episodes.actions, np.ones(len(episodes.actions), np.bool_)),
    }
    for field, (values, counts) in fields.items():
        # A column with a NaN is none: NaN is not equal to itself.
        constant = np.flatnonzero((values[counts] == values[0]).all(axis=0)).tolist()
        if constant:
            changes = f"{'never changes' if len(constant) == 1 else 'never change'}: {_listed(constant)}."
            text = f"{counted(len(constant), 'column')} of {field} {changes}"
            yield Finding("note", f"{field}-constant", len(constant), text)
    if not reading.rewards:
        lacks = counted(reading.rewardless, "episode or file has", "episodes or files have")
        text = f"{lacks} no rewards, and none is read" if reading.rewardless else "There are no rewards"
        text += ", so that the data has no returns and no score; no method reads them."
        yield Finding("caution", "no-rewards", max(1, reading.rewardless), text)


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
    if count := len(reading.endless):
        only_last = reading.endless.tolist() == [len(lengths) - 1]
        which = "The last episode has" if only_last else counted(count, "episode has", "episodes have")
        first = "" if only_last else f" ({'' if count == 1 else 'the first is '}episode {int(reading.endless[0]):,})"
        text = f"{which} no end{first}; {'it is' if count == 1 else 'they are'} read as cut by time."
        yield Finding("note" if only_last else "caution", "unfinished", count, text)
    if count := len(reading.ended_within):
        marked = counted(count, "row is marked as the last of its", "rows are marked as the last of their")
        text = f"{marked} episode, and more of it follows ({_rows(reading.ended_within)}); the reader goes on."
        yield Finding("caution", "ended-within", count, text)
    if count := reading.both_flags:
        text = f"{counted(count, 'episode is', 'episodes are')} both terminated and timed out."
        yield Finding("caution", "both-flags", count, text)
    if not reading.ends_known:
        text = "The observation that an episode ends in is not in the file; steps that lead there have no successor."
        yield Finding("note", "ends-unknown", len(lengths), text)
    if not reading.timeouts:
        text = "The file does not say which episodes time ended."
        severity: Severity = "caution" if reading.format in ("d4rl", "npz") else "note"
        yield Finding(severity, "no-timeouts", len(lengths), text)
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
    flagged[reading.endless] = False
    if shortened:
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


def _widths(keys: Mapping[str, int]) -> str:
    """``position (5), image``; a key without a width is not a list of vectors."""
    return enumerated([f"{shown(key)} ({width})" if width else shown(key) for key, width in keys.items()])


def _rows(rows: IntArray) -> str:
    """``rows 299 and 549``, or the first of many."""
    if 1 < len(rows) <= FEW_ROWS:
        return f"rows {', '.join(f'{row:,}' for row in rows[:-1])} and {rows[-1]:,}"
    return _first(rows)


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
