"""Firewall between data and methods: a view of the declared fields, with no tensor beyond them.

Rewards never leave `Episodes`. Expert actions exist here only for a method that declares its access to them.
The origin of an offline row is hidden: there is no label, and the rows are permuted, so that the index that a draw
chose does not reveal the part that a row comes from.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, TypeAlias, get_args

import numpy as np
import torch

from lfobench.contract.episodes import IntArray
from lfobench.contract.method import Batch, DataNeeds, Field, Method, Shapes, Sizes
from lfobench.data.boundaries import Rows
from lfobench.data.mixing import Mixture, ObservationTransform
from lfobench.randomness import Randomness

if TYPE_CHECKING:
    from torch import Tensor

Column: TypeAlias = "tuple[Tensor, Tensor | None]"


class FirewallError(Exception):
    """A method asks for something that its declaration does not allow: a defect of the method."""


class Table:
    """Rows of one part of the data, on a device: declared fields only.

    Args:
        columns: per field, the storage ``[M, ...]`` and the index of every row into it, ``[R]`` (int32 or int64);
            no index where row r of the storage is the field of row r.
        sampled: rows that training draws.
        rows: rows in all, at least `sampled`.
        per_seed: per field, values ``[S, R]`` of every row that differ between seeds.
    """

    def __init__(
        self,
        columns: Mapping[Field, Column],
        sampled: int,
        rows: int,
        per_seed: Mapping[Field, Tensor] | None = None,
    ) -> None:
        self._columns = dict(columns)
        self._per_seed = dict(per_seed or {})
        self.sampled = sampled
        self.rows = rows

    @property
    def fields(self) -> tuple[Field, ...]:
        """The fields that a batch of this table holds."""
        return (*self._columns, *self._per_seed)

    def of_seeds(self, places: Sequence[int]) -> Table:
        """The same rows for some of the seeds, by their places on the axis."""
        per_seed = {field: values[list(places)] for field, values in self._per_seed.items()}
        return Table(self._columns, self.sampled, self.rows, per_seed)

    def batch(self, row: Tensor) -> Batch:
        """Rows ``[S, B]`` of every field, ``[S, B, ...]``."""
        # index_select costs a CPU a fraction of what storage[index[row]] does: most of a batch's time is here.
        flat = row.reshape(-1)
        batch: dict[Field, Tensor] = {}
        for field, (storage, index) in self._columns.items():
            place = flat if index is None else index.index_select(0, flat)
            batch[field] = storage.index_select(0, place).view(*row.shape, *storage.shape[1:])
        for field, values in self._per_seed.items():
            batch[field] = values.gather(1, row)
        return batch


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

    def of_seeds(self, places: Sequence[int]) -> View:
        """The view of some of the seeds, by their places on the axis."""
        return replace(self, offline=self.offline.of_seeds(places))


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
    if "label" in needs.expert:
        raise FirewallError(f"Method '{method.name}' asks for labels of the expert; only offline data has them.")
    prepares = getattr(method.prepare, "__func__", method.prepare) is not Method.prepare.__func__  # type: ignore[attr-defined]
    if "label" in needs.offline and not prepares:
        raise FirewallError(f"Method '{method.name}' asks for 'label' and defines no `prepare` that computes it.")
    if "initial_observation" in needs.expert:
        raise FirewallError(f"Method '{method.name}' asks for initial observations of the expert; only offline has.")


def view(
    method: type[Method], needs: DataNeeds, mixture: Mixture, device: torch.device, labels: Tensor | None = None
) -> View:
    """The declared fields of a mixture, on `device`.

    Args:
        method: whose view it is.
        needs: its declaration.
        mixture: the data.
        device: where the tensors go.
        labels: ``[A]`` or ``[S, A]`` by action, for a method that asks for them.

    Raises:
        FirewallError: for a declaration that is not allowed.
    """
    check_declaration(method, needs)
    observations = torch.from_numpy(mixture.observations).to(device)
    actions = torch.from_numpy(mixture.actions)
    # A random order that depends on the whole data only.
    randomness = Randomness([zlib.crc32(np.ascontiguousarray(mixture.actions).data)])
    sampled, episodes = mixture.offline.sampled, len(mixture.initial)
    order = torch.arange(len(mixture.offline))
    order[:sampled] = _permutation(randomness, sampled)
    initial: dict[Field, Column] = {}
    if "initial_observation" in needs.offline:
        index = _index(mixture.initial, observations).index_select(0, _permutation(randomness, episodes))
        initial["initial_observation"] = (observations, index.to(device))
    return View(
        offline=_table(needs.offline, mixture.offline, observations, actions, order, labels),
        initial=Table(initial, episodes, episodes),
        expert=_table(needs.expert, mixture.expert, observations, actions, None, None),
        shapes=Shapes(mixture.transform.size, mixture.actions.shape[1]),
        transform=mixture.transform,
    )


def _permutation(randomness: Randomness, count: int) -> Tensor:
    """A random order ``[count]``."""
    return randomness.permutation("order of the rows", 0, count)[0]


def _index(index: IntArray, storage: Tensor) -> Tensor:
    """The index as int32 where that reaches every row of `storage`: half the memory that lookups go through."""
    return torch.from_numpy(index).to(torch.int32 if len(storage) <= torch.iinfo(torch.int32).max else torch.int64)


def _table(
    fields: tuple[Field, ...],
    rows: Rows,
    observations: Tensor,
    actions: Tensor,
    order: Tensor | None,
    labels: Tensor | None,
) -> Table:
    """The rows in `order` ``[R]``, or as they are."""
    device = observations.device
    indices = {
        "observation": rows.observation,
        "next_observation": rows.next_observation,
        "second_next_observation": rows.second_next_observation,
    }

    def ordered(values: Tensor) -> Tensor:
        return (values if order is None else values.index_select(0, order)).to(device)

    columns: dict[Field, Column] = {}
    per_seed: dict[Field, Tensor] = {}
    for field in fields:
        if field == "label" and labels is not None:
            values = labels.index_select(-1, torch.from_numpy(rows.action))
            values = values if order is None else values.index_select(-1, order)
            if labels.dim() == 1:
                columns[field] = (values.to(device), None)
            else:
                per_seed[field] = values.to(device)
        elif field == "action":
            # Only the actions of these rows: the expert's others have no place here.
            columns[field] = (ordered(actions.index_select(0, torch.from_numpy(rows.action))), None)
        elif field == "terminated":
            columns[field] = (ordered(torch.from_numpy(rows.terminated).to(torch.float32)), None)
        elif (index := indices.get(field)) is not None:
            columns[field] = (observations, ordered(_index(index, observations)))
    return Table(columns, rows.sampled, len(rows), per_seed)
