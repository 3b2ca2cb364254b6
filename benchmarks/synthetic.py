"""Random data of a task's shape, as the authors' loops and as the engine hold it. A step costs the same on any data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from benchmarks.authors.host import Array, Columns, HostData
from lfobench.contract.method import DataNeeds, Field, Shapes
from lfobench.data.firewall import Table, View
from lfobench.data.mixing import ObservationTransform

OFFLINE_ROWS = 1_200_000
EXPERT_ROWS = 999
TRANSITIONS_PER_START = 1000

# Observation and action lengths of the seed paper's tasks (methods.md 2.5 and 8).
SHAPES = {
    "hopper": Shapes(11, 3),
    "halfcheetah": Shapes(17, 6),
    "walker2d": Shapes(17, 6),
    "ant": Shapes(111, 8),
    "pen": Shapes(45, 24),
    "door": Shapes(39, 28),
    "hammer": Shapes(46, 26),
    "kitchen": Shapes(60, 9),
}


@dataclass(frozen=True)
class Synthetic:
    """Trajectories of noise: row i is followed by row i + 1, and nothing ends.

    Attributes:
        shapes: of a method's observations (absorbing indicator included) and actions.
        offline_observations: ``[N + 2, obs]``.
        offline_actions: ``[N, act]``.
        expert_observations: ``[E + 2, obs]``.
        expert_actions: ``[E, act]``.
    """

    shapes: Shapes
    offline_observations: Array
    offline_actions: Array
    expert_observations: Array
    expert_actions: Array

    def host(self) -> HostData:
        """Arrays of their own per field, as the authors' readers leave them."""
        starts = np.ascontiguousarray(self.offline_observations[:-2:TRANSITIONS_PER_START])
        return HostData(
            offline=_columns(self.offline_observations, self.offline_actions),
            initial={"initial_observation": starts},
            expert=_columns(self.expert_observations, self.expert_actions),
        )

    def view(self, needs: DataNeeds, device: torch.device) -> View:
        """The fields that a method declares, on `device`: one stack of observations and indices into it."""
        offline: list[Field] = [field for field in needs.offline if field != "initial_observation"]
        initial: dict[Field, tuple[Tensor, Tensor]] = {}
        order = torch.from_numpy(np.random.default_rng(1).permutation(len(self.offline_actions)))
        storage = torch.from_numpy(self.offline_observations).to(device)
        if "initial_observation" in needs.offline:
            index = torch.arange(0, len(self.offline_actions), TRANSITIONS_PER_START, device=device)
            initial["initial_observation"] = (storage, index)
        starts = len(next(iter(initial.values()))[1]) if initial else 0
        expert_order = torch.arange(len(self.expert_actions))
        expert_storage = torch.from_numpy(self.expert_observations).to(device)
        zeros = np.zeros(self.shapes.observation, np.float32)
        return View(
            offline=_table(offline, storage, self.offline_actions, order),
            initial=Table(initial, starts, starts),
            expert=_table(needs.expert, expert_storage, self.expert_actions, expert_order),
            shapes=self.shapes,
            transform=ObservationTransform(zeros, zeros + 1.0, False),
        )


def synthetic(shapes: Shapes, offline_rows: int = OFFLINE_ROWS, expert_rows: int = EXPERT_ROWS) -> Synthetic:
    """Observations N(0, 1) and actions U(-1, 1), the same on every call."""
    generator = np.random.default_rng(0)

    def observations(rows: int) -> Array:
        return generator.standard_normal((rows + 2, shapes.observation), dtype=np.float32)

    def actions(rows: int) -> Array:
        drawn: Array = generator.random((rows, shapes.action), dtype=np.float32) * np.float32(2) - np.float32(1)
        return drawn

    return Synthetic(
        shapes, observations(offline_rows), actions(offline_rows), observations(expert_rows), actions(expert_rows)
    )


def _columns(observations: Array, actions: Array) -> Columns:
    zeros = np.zeros(len(actions), np.float32)
    return {
        "observation": np.ascontiguousarray(observations[:-2]),
        "next_observation": np.ascontiguousarray(observations[1:-1]),
        "second_next_observation": np.ascontiguousarray(observations[2:]),
        "action": actions,
        "reward": zeros,
        "terminated": zeros.copy(),
    }


def _table(fields: Sequence[Field], storage: Tensor, actions: Array, order: Tensor) -> Table:
    """Rows in the order that the firewall would give them: for the offline part, none that memory likes."""
    device, rows = storage.device, len(order)
    every_row = torch.arange(rows, device=device)
    columns: dict[Field, tuple[Tensor, Tensor]] = {}
    for field in fields:
        if field == "action":
            columns[field] = (torch.from_numpy(actions[order.numpy()]).to(device), every_row)
        elif field == "terminated":
            columns[field] = (torch.zeros(rows, device=device), every_row)
        else:
            ahead = {"observation": 0, "next_observation": 1, "second_next_observation": 2}[field]
            columns[field] = (storage, (order + ahead).to(device))
    return Table(columns, rows, rows)
