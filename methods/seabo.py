"""SEABO: search-based reward for offline imitation from observation (Lyu et al., ICLR 2024), with IQL.

An offline transition is rewarded by how near it lies to the nearest one of the expert's, E:

    d_i = min over (e, e') of E of ||(s_i, s'_i) - (e, e')||             in raw observations, but under ``standardize``
    r_i = alpha exp(-beta d_i / D)                                       D: dimensions of an action

once, before training; then implicit Q-learning on (s, a, r, s') (`lfobench.nn.iql`). The labels take no training and
no expert action.

Released code against paper and against this file:

- Its default searches (s, a, s') with the expert's actions. Only (s, s'), the paper's observation form, is here.
- Its expert is the trajectory of highest true return inside the same dataset; here it is the task's demonstration.
- For k > 1 it takes the distance to the k-th neighbour alone (``kth``), not a mean of the nearest k (``mean``).
- It divides by the number of action dimensions although no action is searched.
- The paper tunes alpha and beta on single datasets; one setting serves all here.
- Rewards are positive, so that staying alive pays in itself where episodes terminate.
- On Adroit it has B = 0.5 and dropout of 0.1 in the policy; neither is here.

The true successor of every step is searched (``exact``). A step whose successor is not recorded has no row there, and
label 0.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import torch
from pydantic import Field

from lfobench.contract.method import (
    WHOLE_RUN,
    Batch,
    DataNeeds,
    Method,
    Metrics,
    Shapes,
    Trajectories,
    UnsuitableData,
)
from lfobench.nn.iql import Iql, IqlConfig
from lfobench.randomness import StepRandomness
from methods import DEMO, SMOKE

if TYPE_CHECKING:
    from torch import Tensor

QUICK = {
    "learning_rate": 1e-3,
    "policy_cosine_steps": WHOLE_RUN,
    "target_rate": 0.02,
    "standardize": True,
}
ROWS_AT_ONCE = 2048
"""Of a table of distances to every pair of the expert's."""


class SeaboConfig(IqlConfig):
    """Hyperparameters of SEABO."""

    scale: float = Field(1.0, gt=0, description="alpha, the largest reward.")
    decay: float = Field(0.5, ge=0, description="beta, how fast rewards fall with the distance.")
    neighbours: int = Field(1, ge=1, description="k, neighbours that are searched.")
    distance: Literal["kth", "mean"] = Field("kth", description="Distance to the k-th neighbour, or mean over all k.")


class Seabo(Method):
    """Nearest expert transition as a reward, then implicit Q-learning."""

    name = "seabo"
    Config = SeaboConfig
    config: SeaboConfig
    stated = ("decay", "inverse_temperature")
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {"released": {}, "paper": {}}
    budgets: ClassVar[Mapping[str, Mapping[str, Any]]] = {"quick": QUICK, "demo": {**QUICK, **DEMO}, "smoke": SMOKE}

    @classmethod
    def needs(cls, config: SeaboConfig) -> DataNeeds:
        """Offline transitions with labels; expert pairs without actions."""
        return DataNeeds(
            offline=("observation", "action", "next_observation", "terminated", "label"),
            expert=("observation", "next_observation"),
            boundary="exact",
            termination="zero",
            standardize=config.standardize,
        )

    @classmethod
    def prepare(
        cls,
        config: SeaboConfig,
        offline: Trajectories,
        expert: Trajectories,
        seeds: Sequence[int],
        progress: Callable[[float], None],
    ) -> Tensor:
        """``r = alpha exp(-beta d / D)`` of every offline transition, ``[N]``.

        Raises:
            UnsuitableData: the expert has fewer than k transitions.
        """
        assert offline.actions is not None
        queries, pairs = successive(offline), successive(expert)
        pairs = pairs[~pairs.isnan().any(-1)]
        if len(pairs) < config.neighbours:
            raise UnsuitableData(
                f"seabo searches {config.neighbours} neighbours, and the expert has {len(pairs)} transitions.",
                f"Set seabo.neighbours to at most {len(pairs)}, or take more demonstrations.",
            )
        distances = []
        for start in range(0, len(queries), ROWS_AT_ONCE):
            distances.append(distance(queries[start : start + ROWS_AT_ONCE], pairs, config))
            progress(min(1.0, (start + ROWS_AT_ONCE) / len(queries)))
        found = torch.cat(distances)
        reward = config.scale * torch.exp(-config.decay * found / offline.actions.shape[-1])
        return torch.where(found.isnan(), 0.0, reward).float()

    def __init__(self, config: SeaboConfig, shapes: Shapes, seeds: Sequence[int], device: torch.device) -> None:
        self.iql = Iql(shapes, seeds, device, config)

    def update(self, stage: str, offline: Batch, expert: Batch, randomness: StepRandomness) -> Metrics:
        """A step of implicit Q-learning on the labels."""
        return self.iql.update(offline, offline["label"])

    def act(self, observation: Tensor) -> Tensor:
        """``pi(s)``, or its mean."""
        return self.iql.policy.act(observation)


def successive(trajectories: Trajectories) -> Tensor:
    """``(s, s')`` of every transition, in float64 because distances of near neighbours cancel, ``[N, 2 obs]``."""
    return torch.cat([torch.cat((each[:-1], each[1:]), dim=-1) for each in trajectories.split()]).double()


def distance(queries: Tensor, pairs: Tensor, config: SeaboConfig) -> Tensor:
    """Distance of each query to its neighbours among the expert's pairs, ``[n]``; NaN for a query that has one."""
    table = torch.cdist(queries, pairs, compute_mode="donot_use_mm_for_euclid_dist")
    nearest = table.topk(config.neighbours, largest=False).values
    found = nearest[:, -1] if config.distance == "kth" else nearest.mean(-1)
    return torch.where(queries.isnan().any(-1), torch.nan, found)
