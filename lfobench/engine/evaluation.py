"""Evaluation of a method on a task: every episode from its own fixed start, in this process."""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import gymnasium
import numpy as np
import torch
from numpy.typing import NDArray

from lfobench.cells.cell import Cell, Starts
from lfobench.contract.environment import ActionBox, Environment
from lfobench.contract.episodes import FloatArray
from lfobench.contract.method import Method
from lfobench.contract.suite import Task
from lfobench.data.mixing import ObservationTransform

if TYPE_CHECKING:
    from torch import Tensor


@dataclass(frozen=True)
class Stepped:
    """Results of one step of the running worlds, in the order in which they were named.

    Attributes:
        rewards: of each.
        over: whether its episode ended.
        outcomes: how it ended, where the environment says so; None otherwise.
    """

    rewards: Sequence[float]
    over: Sequence[bool]
    outcomes: Sequence[str | None]


class Simulators(Protocol):
    """A number of worlds, each with an episode of its own."""

    def __len__(self) -> int:
        """Number of worlds."""
        ...

    def reset(self, seeds: Sequence[int]) -> FloatArray:
        """Start an episode in every world; observations ``[n, obs]``."""
        ...

    def step(self, action: FloatArray, running: Sequence[int], observation: FloatArray) -> Stepped:
        """Step the worlds `running` with their rows of `action` ``[n, act]``; their rows of `observation` change.

        Actions are a method's, in [-1, 1].
        """
        ...

    def close(self) -> None:
        """Release them."""
        ...


def simulators(environment: Environment, count: int) -> Simulators:
    """`count` worlds of an environment: as a vector environment where it has that form."""
    together = environment.make_many(count)
    return OneByOne([environment.make() for _ in range(count)]) if together is None else Together(together)


class OneByOne:
    """Environments that step in turn."""

    def __init__(self, environments: Sequence[gymnasium.Env[Any, Any]]) -> None:
        self._environments = environments
        self._steps = [environment.step for environment in environments]
        self._box = ActionBox.of(environments[0].action_space)

    def __len__(self) -> int:
        return len(self._environments)

    def reset(self, seeds: Sequence[int]) -> FloatArray:
        """See `Simulators`."""
        starts = zip(self._environments, seeds, strict=True)
        return np.stack([np.asarray(world.reset(seed=seed)[0], np.float32) for world, seed in starts])

    def step(self, action: FloatArray, running: Sequence[int], observation: FloatArray) -> Stepped:
        """See `Simulators`."""
        # Lists, because NumPy charges for every element that is read or written on its own.
        rewards, over, outcomes = [], [], []
        action = self._box.in_units(action)
        for world in running:
            observation[world], reward, terminated, truncated, info = self._steps[world](action[world])
            rewards.append(float(reward))
            over.append(bool(terminated or truncated))
            outcomes.append(info.get("outcome") if over[-1] else None)
        return Stepped(rewards, over, outcomes)

    def close(self) -> None:
        """See `Simulators`."""
        for environment in self._environments:
            environment.close()


class Together:
    """A vector environment that leaves a finished world alone until all are reset."""

    def __init__(self, environment: gymnasium.vector.VectorEnv[Any, Any, Any]) -> None:
        self._environment = environment
        self._box = ActionBox.of(environment.single_action_space)

    def __len__(self) -> int:
        return self._environment.num_envs

    def reset(self, seeds: Sequence[int]) -> FloatArray:
        """See `Simulators`."""
        observation, _ = self._environment.reset(seed=list(seeds))  # type: ignore[arg-type]  # one per world, as SyncVectorEnv takes them
        return np.array(observation, np.float32)

    def step(self, action: FloatArray, running: Sequence[int], observation: FloatArray) -> Stepped:
        """See `Simulators`."""
        found, rewards, terminated, truncated, info = self._environment.step(self._box.in_units(action))
        observation[running] = np.asarray(found, np.float32)[running]
        over = np.logical_or(terminated, truncated)[running]
        outcomes: Sequence[str | None] = [None] * len(running)
        if "outcome" in info and over.any():
            known = info["_outcome"][running] & over
            outcomes = [str(what) if said else None for what, said in zip(info["outcome"][running], known, strict=True)]
        return Stepped(np.asarray(rewards)[running].tolist(), over.tolist(), outcomes)

    def close(self) -> None:
        """See `Simulators`."""
        self._environment.close()


@dataclass(frozen=True)
class EpisodeResults:
    """Results of S seeds in K episodes each.

    Attributes:
        returns: raw returns ``[S, K]``.
        lengths: steps ``[S, K]``.
        finite: ``[S]``; False for a seed that answered a running episode with a non-finite action.
        outcomes: how every episode ended, seed by seed; None where the environment does not say so of each.
    """

    returns: NDArray[np.float64]
    lengths: NDArray[np.int64]
    finite: NDArray[np.bool_]
    outcomes: list[list[str]] | None = None


def rollout(
    act: Callable[[Tensor], Tensor],
    transform: ObservationTransform,
    simulators: Simulators,
    starts: Sequence[int],
) -> EpisodeResults:
    """K episodes of each of S seeds; a finished episode's slot is kept, so shapes never depend on who falls first.

    Args:
        act: actions on the host for observations, ``[S, K, obs] -> [S, K, act]``.
        transform: from the simulator's observation to the policy's.
        simulators: ``S * K`` worlds, seed by seed.
        starts: seed of the reset of episode k, one per episode.

    Raises:
        ValueError: for simulators that are not K per seed.
    """
    slots, episodes = len(simulators), len(starts)
    if slots % episodes:
        raise ValueError(f"{slots} simulators cannot hold {episodes} episodes per seed")
    seeds = slots // episodes
    raw = simulators.reset([*starts] * seeds)
    # Lists, because NumPy charges for every element that is read or written on its own.
    returns, lengths, finite = [0.0] * slots, [0] * slots, [True] * slots
    outcomes: list[str | None] = [None] * slots
    running, time = list(range(slots)), 0
    # Not inference_mode: whatever a method keeps from acting may meet a gradient in its next update.
    with torch.no_grad():
        while running:
            observation = torch.from_numpy(transform(raw)).view(seeds, episodes, -1)
            action = act(observation).numpy().reshape(slots, -1)
            sound = np.isfinite(action)
            if not sound.all():
                # A diverged seed may answer NaN; the simulator must not see it.
                for slot in running:
                    finite[slot] = finite[slot] and bool(sound[slot].all())
                action = np.where(sound, action, np.float32(0.0))
            time += 1
            stepped = simulators.step(action, running, raw)
            for slot, reward in zip(running, stepped.rewards, strict=True):
                returns[slot] += reward
            if any(stepped.over):
                for slot, over, outcome in zip(running, stepped.over, stepped.outcomes, strict=True):
                    if over:
                        lengths[slot], outcomes[slot] = time, outcome
                running = [slot for slot in running if not lengths[slot]]
    shape = (seeds, episodes)
    known = [outcome for outcome in outcomes if outcome is not None]
    by_seed = [known[first : first + episodes] for first in range(0, slots, episodes)]
    return EpisodeResults(
        returns=np.array(returns).reshape(shape),
        lengths=np.array(lengths, np.int64).reshape(shape),
        finite=np.array(finite).reshape(shape).all(-1),
        outcomes=by_seed if len(known) == slots else None,
    )


def start_seed(task: Task, episode: int, starts: Starts = "evaluation") -> int:
    """Seed of the reset of episode k: the same for every method, seed and step of a task."""
    return zlib.crc32(f"{starts} {task.name} {episode}".encode())


class Evaluator:
    """Runs a method's policies in the simulator.

    Args:
        task: names the environment and fixes the starts.
        transform: from the simulator's observation to the method's.
        seeds: length S of the seed axis.
        episodes: which of the starts; K of them.
        starts: the tests', or those of a choice between trials.
    """

    def __init__(
        self,
        task: Task,
        transform: ObservationTransform,
        seeds: int,
        episodes: range,
        starts: Starts = "evaluation",
    ) -> None:
        self._environment = task.environment
        self._transform = transform
        self._slots = seeds * len(episodes)
        self._starts = [start_seed(task, episode, starts) for episode in episodes]
        self._simulators: Simulators | None = None

    def evaluate(self, method: Method, device: torch.device) -> EpisodeResults:
        """K episodes per seed, in lock step."""
        if self._simulators is None:
            self._simulators = simulators(self._environment, self._slots)
        return rollout(
            lambda observation: method.act(observation.to(device)).cpu(),
            self._transform,
            self._simulators,
            self._starts,
        )

    def close(self) -> None:
        """Release the simulators."""
        if self._simulators is not None:
            self._simulators.close()
        self._simulators = None


def fixed_starts(cell: Cell) -> range:
    """The fixed starts of every evaluation."""
    return range(cell.protocol.evaluation_episodes)


def final_starts(cell: Cell) -> range:
    """The starts from which the trained policy alone is run."""
    first = cell.protocol.evaluation_episodes
    return range(first, first + cell.protocol.further_episodes)
