"""The generated source: rollouts of demonstrators, in shards of a part, and recordings of operators.

Shard i depends on the part's specification and i alone, so parts are built in parallel, extended later, and a
smaller protocol reads a prefix of a larger one's data.
"""

from __future__ import annotations

import numpy as np

from lfobench.contract.episodes import Episodes, FloatArray
from lfobench.contract.suite import Demonstrator, Environment, Operator
from lfobench.plan.parts import PartSpecification


def record(specification: PartSpecification, operator: Operator) -> Episodes:
    """A recorded part: as many episodes as its specification says.

    Raises:
        ValueError: when the operator records another number, what its environment would not, or what is no number.
    """
    wanted = specification.episodes or 0
    episodes = operator.record(wanted, _generator(specification, 0))
    if len(episodes.lengths) != wanted:
        raise ValueError(f"the operator was asked for {wanted} episodes and recorded {len(episodes.lengths)}")
    _check_recording(episodes, specification.environment)
    return episodes


def _check_recording(episodes: Episodes, environment: Environment) -> None:
    for name, wanted in environment.spaces.shapes.items():
        columns = getattr(episodes, name).shape[1:]
        if columns != wanted:
            raise ValueError(f"{name} has rows of shape {columns}; those of {environment.id} are of shape {wanted}")
    for name in ("observations", "rewards"):
        if not np.isfinite(getattr(episodes, name)).all():
            raise ValueError(f"{name} has a value that is not a finite number")
    if np.isnan(episodes.actions).all():
        return  # nothing was commanded; a recipe says whether it can do without
    box = environment.spaces.actions
    if not ((episodes.actions >= box.low) & (episodes.actions <= box.high)).all():
        raise ValueError(f"actions has a value that is not a number in {box}")


def roll_out(
    specification: PartSpecification, demonstrator: Demonstrator, shard: int, transitions: int | None = None
) -> Episodes:
    """Whole episodes of a shard until at least `transitions` steps are made; by default the whole shard."""
    wanted = specification.shard_transitions if transitions is None else transitions
    generator = _generator(specification, shard)
    environment = specification.environment.make()
    observations: list[FloatArray] = []
    actions: list[FloatArray] = []
    rewards: list[float] = []
    lengths: list[int] = []
    terminations: list[bool] = []
    try:
        while sum(lengths) < wanted:
            observation, _ = environment.reset(seed=int(generator.integers(2**31)))
            observations.append(np.asarray(observation, np.float32))
            length, terminated, truncated = 0, False, False
            while not (terminated or truncated):
                action = demonstrator.act(observations[-1], generator)
                observation, reward, terminated, truncated, _ = environment.step(action)
                observations.append(np.asarray(observation, np.float32))
                actions.append(action)
                rewards.append(float(reward))
                length += 1
            lengths.append(length)
            terminations.append(terminated)
    finally:
        environment.close()
    return Episodes(
        np.stack(observations),
        np.stack(actions).astype(np.float32),
        np.asarray(rewards, np.float32),
        np.asarray(lengths, np.int64),
        np.asarray(terminations, np.bool_),
    )


def _generator(specification: PartSpecification, shard: int) -> np.random.Generator:
    key = np.random.SeedSequence([int(specification.hash[:16], 16), shard])
    return np.random.Generator(np.random.Philox(key))
