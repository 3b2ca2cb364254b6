"""Workloads: a method's stage, the authors' loop of it, and its inventory of products."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from benchmarks.authors.bc import AuthorsBc
from benchmarks.authors.bco import AuthorsBcoInverseDynamics, AuthorsBcoPolicy
from benchmarks.authors.dilo import AuthorsDilo
from benchmarks.authors.loop import Array, Columns, HostData, Loop
from benchmarks.authors.oril import AuthorsOril
from benchmarks.authors.smodice import AuthorsSmodice
from benchmarks.flops import Account, Inventory, Pass, bc, bco_inverse_dynamics, bco_policy, dilo, oril, smodice
from lfobench.cells.cell import Precision
from lfobench.contract.method import DataNeeds, Field, Method, MethodConfig, Shapes
from lfobench.data.firewall import Table, View
from lfobench.data.mixing import ObservationTransform
from lfobench.engine.program import Program, recorder_for
from lfobench.randomness import Randomness
from methods.bc import Bc
from methods.bco import INVERSE_DYNAMICS, Bco
from methods.dilo import Dilo
from methods.oril import Oril
from methods.smodice import Smodice

OFFLINE_ROWS = 1_200_000
EXPERT_ROWS = 999
TRANSITIONS_PER_START = 1000

# Observation and action lengths of the tasks of DILO's paper.
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
    """Rows in the order that the firewall would give them: for the offline part, without locality."""
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


def engine_step(
    method_class: type[Method],
    config: MethodConfig,
    view: View,
    seeds: Sequence[int],
    device: torch.device,
    stage: str | None = None,
    precision: Precision = "auto",
) -> Callable[[], None]:
    """A call that samples and updates once, for every seed.

    Args:
        method_class: what trains.
        config: its hyperparameters.
        view: the data, on `device`.
        seeds: the seed axis.
        device: where it trains.
        stage: name of a stage; None for the last one.
        precision: of matrix products.
    """
    method = method_class(config, view.shapes, seeds, device)
    stages = method.stages(view.sizes)
    running = stages[-1] if stage is None else next(found for found in stages if found.name == stage)
    randomness = Randomness(seeds, device)
    program = Program(method, view, running, randomness, precision=precision, recorder=recorder_for(device))
    step = 0

    def run() -> None:
        nonlocal step
        program.update(step)
        step += 1

    return run


@dataclass(frozen=True)
class Workload:
    """A training step in its three forms.

    Attributes:
        name: of the method, and of the stage if it is not the last.
        method: the engine's.
        authors: builds the authors' loop from host data, shapes, batch size and device.
        inventory: the products of the formulas.
        stage: of the method; None for its last.
        period: steps after which the work repeats.
    """

    name: str
    method: type[Method]
    authors: Callable[[HostData, Shapes, int, torch.device], Loop]
    inventory: Inventory
    stage: str | None = None
    period: int = 1

    @property
    def released_batch(self) -> int:
        """Rows of a released batch."""
        return int(self._config().batch_size)

    def shapes(self, task: Shapes) -> Shapes:
        """A task's shapes as this method sees them: with the absorbing indicator where it asks for one."""
        indicator = self.method.needs(self._config()).termination == "absorbing"
        return Shapes(task.observation + int(indicator), task.action)

    def data(self, task: Shapes, offline_rows: int = OFFLINE_ROWS, expert_rows: int = EXPERT_ROWS) -> Synthetic:
        """Random data in those shapes."""
        return synthetic(self.shapes(task), offline_rows, expert_rows)

    def authors_step(self, data: Synthetic, batch: int, device: torch.device) -> Callable[[], object]:
        """One call is one step of the authors' loop."""
        return self.authors(data.host(), data.shapes, batch, device).step

    def engine_step(
        self, data: Synthetic, batch: int, seeds: int, device: torch.device, precision: Precision = "auto"
    ) -> Callable[[], None]:
        """One call is one step of the engine, for that many seeds."""
        config = self._config(batch_size=batch)
        view = data.view(self.method.needs(config), device)
        return engine_step(self.method, config, view, range(seeds), device, self.stage, precision)

    def passes(self, shapes: Shapes, batch: int, account: Account = "needed") -> tuple[Pass, ...]:
        """The inventory at the method's widths; `shapes` as `shapes` gives them."""
        return self.inventory(shapes, batch, self._config().hidden, account)

    def _config(self, **overrides: Any) -> Any:
        return self.method.Config(**overrides)


WORKLOADS = {
    workload.name: workload
    for workload in (
        Workload("dilo", Dilo, AuthorsDilo, dilo),
        Workload("smodice", Smodice, AuthorsSmodice, smodice),
        Workload("oril", Oril, AuthorsOril, oril, period=2),
        Workload("bco", Bco, AuthorsBcoPolicy, bco_policy),
        Workload("bco inverse dynamics", Bco, AuthorsBcoInverseDynamics, bco_inverse_dynamics, INVERSE_DYNAMICS),
        Workload("bc", Bc, AuthorsBc, bc),
    )
}
