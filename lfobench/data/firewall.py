"""What a method is handed: the fields it declared, and no tensor beyond them (decision 3).

Rewards never leave `Episodes`. Expert actions exist here only for a method that declares its access to them.
Nothing tells an offline batch which of its rows came from the expert: there is no label, and the rows lie in an
order of their own, so that not even a guess at the draw that chose a row says which part it is from.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import get_args

import torch
from torch import Tensor

from lfobench.contract.method import Batch, DataNeeds, Field, Method, Shapes, Sizes
from lfobench.contract.randomness import Randomness
from lfobench.data.boundaries import Rows
from lfobench.data.episodes import FloatArray, IntArray
from lfobench.data.mixing import Mixture, ObservationTransform


class FirewallError(Exception):
    """A method asks for something that its declaration does not allow: a defect of the method."""


class Table:
    """Rows of one part of the data, on a device: declared fields only.

    Args:
        columns: per field, the storage ``[M, ...]`` and the index of every row into it, ``[R]``.
        sampled: rows that training draws.
        rows: rows in all, at least `sampled`.
    """

    def __init__(self, columns: Mapping[Field, tuple[Tensor, Tensor]], sampled: int, rows: int) -> None:
        self._columns = dict(columns)
        self.sampled = sampled
        self.rows = rows

    @property
    def fields(self) -> tuple[Field, ...]:
        """The fields that a batch of this table holds."""
        return tuple(self._columns)

    def batch(self, row: Tensor) -> Batch:
        """Rows ``[S, B]`` of every field, ``[S, B, ...]``."""
        return {field: storage[index[row]] for field, (storage, index) in self._columns.items()}


@dataclass(frozen=True)
class View:
    """Everything about a task's data that the engine may use to train one method.

    Attributes:
        offline: the offline data's declared fields.
        initial: first observations of its episodes; empty unless declared.
        expert: the demonstration's declared fields.
        shapes: of the method's observations and actions.
        transform: for the simulator's observations.
    """

    offline: Table
    initial: Table
    expert: Table
    shapes: Shapes
    transform: ObservationTransform

    @property
    def sizes(self) -> Sizes:
        """Rows that training draws from."""
        return Sizes(self.offline.sampled, self.expert.sampled)


def check_declaration(method: type[Method], needs: DataNeeds) -> None:
    """Refuse a declaration of unknown fields, or one that reaches for expert actions without access.

    Raises:
        FirewallError: naming the method and the field.
    """
    for field in (*needs.offline, *needs.expert):
        if field not in get_args(Field):
            raise FirewallError(f"Method '{method.name}' asks for '{field}', which no method is given.")
    if "action" in needs.expert and not method.access_to_expert_actions:
        raise FirewallError(
            f"Method '{method.name}' asks for expert actions but does not declare access_to_expert_actions."
        )
    if "initial_observation" in needs.expert:
        raise FirewallError(f"Method '{method.name}' asks for initial observations of the expert; only offline has.")


def view(method: type[Method], needs: DataNeeds, mixture: Mixture, device: torch.device) -> View:
    """The declared fields of a mixture, on `device`.

    Raises:
        FirewallError: for a declaration that is not allowed.
    """
    check_declaration(method, needs)
    observations = torch.from_numpy(mixture.observations).to(device)
    offline = mixture.offline.reordered(_disorder(mixture, mixture.offline.sampled))
    initial = torch.from_numpy(mixture.initial[_disorder(mixture, len(mixture.initial))]).to(device)
    initial_fields: dict[Field, tuple[Tensor, Tensor]] = {}
    if "initial_observation" in needs.offline:
        initial_fields["initial_observation"] = (observations, initial)
    return View(
        offline=_table(needs.offline, offline, observations, mixture.actions),
        initial=Table(initial_fields, len(initial), len(initial)),
        expert=_table(needs.expert, mixture.expert, observations, mixture.actions),
        shapes=Shapes(mixture.transform.size, mixture.actions.shape[1]),
        transform=mixture.transform,
    )


def _disorder(mixture: Mixture, count: int) -> IntArray:
    """A permutation ``[count]`` that only the whole data decides."""
    key = zlib.crc32(mixture.actions.tobytes())
    return Randomness([key]).permutation("order of the rows", 0, count)[0].numpy()


def _table(fields: tuple[Field, ...], rows: Rows, observations: Tensor, actions: FloatArray) -> Table:
    device = observations.device
    every_row = torch.arange(len(rows), device=device)
    columns: dict[Field, tuple[Tensor, Tensor]] = {}
    indices = {
        "observation": rows.observation,
        "next_observation": rows.next_observation,
        "second_next_observation": rows.second_next_observation,
    }
    for field in fields:
        if field == "action":
            # Only the actions of these rows: the expert's others have no place here.
            columns[field] = (torch.from_numpy(actions[rows.action]).to(device), every_row)
        elif field == "terminated":
            flags = torch.from_numpy(rows.terminated).to(device, torch.float32)
            columns[field] = (flags, every_row)
        elif (index := indices.get(field)) is not None:
            columns[field] = (observations, torch.from_numpy(index).to(device))
    return Table(columns, rows.sampled, len(rows))
