"""Synthetic records: the same shape as a run leaves, with scores chosen by the test."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from lfobench.cells.cell import Run
from lfobench.record import SUCCESS, Evaluation, Labels, Metrics, Record, Tuning, Warning
from lfobench.text import content_hash


def make_record(
    score: float,
    method: str = "dilo",
    seed: int = 0,
    row: str = "hopper",
    group: str = "random+expert",
    *,
    sees_expert_actions: bool = False,
    stated: Sequence[str] = (),
    fingerprints: Mapping[str, str] | None = None,
    diverged_at: int | None = None,
    evaluations: int = 5,
    warnings: Sequence[Warning] = (),
    **identity: Any,
) -> Record:
    """A record whose every episode has the given normalised score; `identity` overrides top-level fields."""
    fields = {
        "method": method,
        "method_version": 1,
        "preset": "released",
        "config": {"batch_size": 256, "tau": 0.06},
        "overrides": {},
        "set": {},
        "task": f"{row}-{group.replace('+', '-')}",
        "environment": {
            "name": row,
            "id": f"{row.capitalize()}-v5",
            "horizon": 1000,
            "random_return": 0.0,
            "expert_return": 1000.0,
            "arguments": {},
        },
        "recipe": {
            "offline": "random",
            "offline_transitions": 1_000_000,
            "expert": "expert",
            "expert_trajectories": 200,
            "demonstration_rows": 1000,
        },
        "source": "generated",
        "data": {"offline": "a1", "expert": "b2"},
        "protocol": {
            "name": "quick",
            "steps": 20_000,
            "steps_assigned": False,
            "evaluation_every": 1000,
            "evaluation_episodes": 10,
        },
        "simulator": {"gymnasium": "1.4.0", "mujoco": "3.3.7"},
        "seed": seed,
    } | identity
    return Record(
        identity_hash=content_hash(fields),
        identity=fields,
        labels=Labels(
            suite="locomotion", group=group, row=row, sees_expert_actions=sees_expert_actions, stated=list(stated)
        ),
        status="finished" if diverged_at is None else "diverged",
        diverged_at=diverged_at,
        evaluations=[
            Evaluation(step=1000 * (index + 1), returns=[score * 10.0] * 2, lengths=[1000] * 2)
            for index in range(evaluations)
        ],
        metrics=[],
        warnings=list(warnings),
        provenance={"data_fingerprints": dict(fingerprints or {})},
    )


def make_cell(scores: Iterable[float], method: str = "dilo", **options: Any) -> list[Record]:
    """One record per score, with seeds 0, 1, 2, …"""
    return [make_record(score, method, seed, **options) for seed, score in enumerate(scores)]


def make_counted(
    fixed: Sequence[str],
    further: Sequence[str] = (),
    method: str = "dilo",
    seed: int = 0,
    row: str = "safe-manipulation",
    group: str = "few-trajectories",
    *,
    evaluations: int = 3,
    diverged_at: int | None = None,
    tuning: Tuning | None = None,
    sees_expert_actions: bool = False,
    **identity: Any,
) -> Record:
    """A record that says how its episodes ended, from the fixed and from further starts; a success returns 1.

    Its earlier evaluations have no success. A run that diverged has none at all, and only plans as many episodes.
    """
    plain = make_record(
        0.0,
        method,
        seed,
        row,
        group,
        diverged_at=diverged_at,
        sees_expert_actions=sees_expert_actions,
        **{
            "task": f"{row}-{group}",
            "environment": {
                "name": row,
                "id": "lfobench/SafeManipulation-v0",
                "horizon": 200,
                "random_return": 0.0,
                "expert_return": 1.0,
                "arguments": {},
            },
            "recipe": {
                "offline": "suboptimal",
                "offline_trajectories": 50,
                "expert": "teleoperation",
                "expert_trajectories": 15,
                "expert_transitions": None,
                "expert_actions": True,
                "equal_transitions": True,
            },
            "protocol": {
                "name": "quick",
                "steps": 3000,
                "steps_assigned": False,
                "evaluation_every": 1000,
                "evaluation_episodes": len(fixed),
                **({"further_episodes": len(further)} if further else {}),
            },
            **identity,
        },
    )
    none = ["out of time"] * len(fixed)
    endings = [*([none] * (evaluations - 1)), list(fixed)] if diverged_at is None else []
    labels = plain.labels.model_copy(update={"suite": "airhockey"})
    return plain.model_copy(
        update={
            "labels": labels,
            "evaluations": [_ended(1000 * (index + 1), outcomes) for index, outcomes in enumerate(endings)],
            "further": _ended(1000 * evaluations, further) if further and diverged_at is None else None,
            "tuning": tuning,
        }
    )


def endings(successes: int, trials: int, failure: str = "cup hit") -> list[str]:
    """That many successes, then failures of one kind."""
    return [SUCCESS] * successes + [failure] * (trials - successes)


def _ended(step: int, outcomes: Sequence[str]) -> Evaluation:
    returns = [float(outcome == SUCCESS) for outcome in outcomes]
    return Evaluation(step=step, returns=returns, lengths=[100] * len(returns), outcomes=list(outcomes))


def record_of(run: Run, **changes: Any) -> Record:
    """A record of a run, with two evaluations."""
    fields: dict[str, Any] = {
        "identity_hash": run.identity_hash,
        "identity": run.identity,
        "labels": run.cell.labels,
        "status": "finished",
        "diverged_at": None,
        "evaluations": [
            Evaluation(step=10, returns=[0.1, 1 / 3], lengths=[3, 4]),
            Evaluation(step=20, returns=[1e-17, 5.5], lengths=[5, 6]),
        ],
        "metrics": [Metrics(stage="policy", step=10, values={"loss": 0.1, "gone": None})],
        "warnings": [Warning(what="low on data", remedy="build more")],
        "provenance": {"device": {"type": "cpu"}, "seconds": {"train": 1.5}},
    }
    return Record(**{**fields, **changes})
