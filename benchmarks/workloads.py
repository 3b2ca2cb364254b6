"""What is timed: a method's stage, the authors' loop of it, and its inventory of products."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch

from benchmarks.authors.bc import AuthorsBc
from benchmarks.authors.bco import AuthorsBcoInverseDynamics, AuthorsBcoPolicy
from benchmarks.authors.dilo import AuthorsDilo
from benchmarks.authors.host import HostData
from benchmarks.authors.loop import Loop
from benchmarks.authors.oril import AuthorsOril
from benchmarks.authors.smodice import AuthorsSmodice
from benchmarks.engine_step import engine_step
from benchmarks.flops import (
    Account,
    Inventory,
    Pass,
    bc,
    bco_inverse_dynamics,
    bco_policy,
    dilo,
    oril,
    smodice,
)
from benchmarks.synthetic import EXPERT_ROWS, OFFLINE_ROWS, Synthetic, synthetic
from lfobench.cells.cell import Precision
from lfobench.contract.method import Method, Shapes
from methods.bc import Bc
from methods.bco import INVERSE_DYNAMICS, Bco
from methods.dilo import Dilo
from methods.oril import Oril
from methods.smodice import Smodice


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
