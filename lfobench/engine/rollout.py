"""Episodes in lock step: a pure function of a policy, its simulators and their starts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from lfobench.data.mixing import ObservationTransform
from lfobench.engine.simulators import Simulators


@dataclass(frozen=True)
class EpisodeResults:
    """What S seeds did in K episodes each.

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
    told = [outcome for outcome in outcomes if outcome is not None]
    by_seed = [told[first : first + episodes] for first in range(0, slots, episodes)]
    return EpisodeResults(
        returns=np.array(returns).reshape(shape),
        lengths=np.array(lengths, np.int64).reshape(shape),
        finite=np.array(finite).reshape(shape).all(-1),
        outcomes=by_seed if len(told) == slots else None,
    )
