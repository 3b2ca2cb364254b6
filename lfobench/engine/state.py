"""The state of a method: everything that training changes in it, found by walking what the method holds.

A walk visits tensors, the networks and optimisers of `lfobench.nn` (anything with ``live_tensors``), `torch.nn.Module`,
`torch.optim.Optimizer` and plain numbers, in attributes, lists, dictionaries and other objects. Which of it belongs to
one seed is not guessed from sizes: the method is built once for one seed and once for two, and what doubles is per
seed.

`capture` gives each seed a state of its own, which `restore` puts back into a method of any seeds: so a checkpoint, a
policy file and an evaluation process need not know which seeds trained together.
"""

from __future__ import annotations

import copy
import random
import re
import weakref
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from enum import Enum
from functools import cache, partial
from pathlib import PurePath
from types import BuiltinFunctionType, FunctionType, MethodType, ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from pydantic import BaseModel

from lfobench.contract.method import Method, Shapes

if TYPE_CHECKING:
    from torch import Tensor


def host() -> torch.device:
    """The CPU, which every machine has; a function, because a constant would load torch for commands that only read."""
    return torch.device("cpu")


PLAIN = (bool, int, float, str, type(None))
PER_SEED = "*"
"""The place of a seed's index in the name of what a list holds for each seed."""

CONSTANTS = (
    type,
    FunctionType,
    BuiltinFunctionType,
    MethodType,
    ModuleType,
    BaseModel,
    Enum,
    PurePath,
    bytes,
    complex,
    frozenset,
    range,
    slice,
    partial,
    re.Pattern,
    weakref.ref,
)
"""Kinds of objects that training does not change."""


@cache
def constants() -> tuple[Any, ...]:
    """The same, with torch's own."""
    return (*CONSTANTS, torch.device, torch.dtype, torch.layout, torch.memory_format)


@cache
def _of_modules() -> set[str]:
    """The attributes of torch's modules that are not state: caches, hooks, and those that are walked otherwise."""
    return set(vars(torch.nn.Module())) - {"training"}


class StateError(Exception):
    """A method whose state cannot be told apart by seed, or not put back: a defect of the method."""


@dataclass(frozen=True)
class SeedState:
    """One seed's part of a method's state.

    Attributes:
        tensors: by name; what all seeds share is part of every seed's state.
        values: plain numbers and lists of them, by name, as JSON data.
    """

    tensors: dict[str, Tensor] = field(default_factory=dict)
    values: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class _Leaf:
    """A live tensor or a plain value, and how to put another one in its place."""

    name: str
    value: Any
    put: Callable[[Any], None]


@dataclass(frozen=True)
class _Walked:
    """The result of a walk.

    Attributes:
        leaves: by name.
        lengths: of every list, by name.
        optimizers: torch's own, by name, with the names of their parameters.
    """

    leaves: dict[str, _Leaf]
    lengths: dict[str, int]
    optimizers: list[tuple[str, torch.optim.Optimizer, list[tuple[str, Tensor]]]]


class _Walk:
    """One visit of everything that an object holds, each thing once."""

    def __init__(self) -> None:
        self.leaves: dict[str, _Leaf] = {}
        self.lengths: dict[str, int] = {}
        self._seen: set[object] = set()
        self._names: dict[int, str] = {}
        self._optimizers: list[tuple[str, torch.optim.Optimizer]] = []
        self._kept: list[object] = []

    def visit(self, name: str, value: Any, put: Callable[[Any], None]) -> None:
        """Walk `value`, which `put` replaces."""
        if isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
            value = torch.from_numpy(value)
        if isinstance(value, torch.Tensor):
            self.tensor(name, value)
        elif isinstance(value, PLAIN):
            self.leaves[name] = _Leaf(name, value, put)
        elif isinstance(value, np.generic):
            number = type(value)
            self.leaves[name] = _Leaf(name, value.item(), lambda new: put(number(new)))
        elif isinstance(value, torch.Generator):
            self.leaves[name] = _Leaf(name, value.get_state(), _generator_setter(value))
        elif isinstance(value, constants()) or (callable(value) and not hasattr(value, "__dict__")):
            return
        elif isinstance(value, (list, tuple)) and all(isinstance(each, PLAIN) for each in value):
            if (kind := type(value)) in (list, tuple):  # a named tuple or a size is a constant
                self.leaves[name] = _Leaf(name, list(value), lambda new: put(kind(new)))
                self.lengths[name] = len(value)
        elif id(value) not in self._seen:
            self._seen.add(id(value))
            self._kept.append(value)  # an id is an object's own only while it lives
            self._container(name, value)

    def finish(self) -> _Walked:
        """The result; optimisers come last, because their state is named after the parameters it belongs to."""
        optimizers = [(name, optimizer, self._optimizer(name, optimizer)) for name, optimizer in self._optimizers]
        return _Walked(self.leaves, self.lengths, optimizers)

    def tensor(self, name: str, tensor: Tensor) -> None:
        """A live tensor, once, whatever the number of names that it has."""
        place = (tensor.data_ptr(), tensor.shape, tensor.stride()) if tensor.numel() else id(tensor)
        if place in self._seen:
            return
        self._seen.add(place)
        self._kept.append(tensor)
        self._names[id(tensor)] = name

        def put(new: Tensor) -> None:
            with torch.no_grad():
                tensor.copy_(new)

        self.leaves[name] = _Leaf(name, tensor, put)

    def _container(self, name: str, value: Any) -> None:
        if isinstance(value, torch.optim.Optimizer):
            self._optimizers.append((name, value))
        elif hasattr(value, "live_tensors"):
            for part, tensor in value.live_tensors().items():
                self.tensor(_joined(name, part), tensor)
        elif isinstance(value, torch.nn.Module):
            self._module(name, value)
        elif isinstance(value, Mapping):
            for key, each in value.items():
                self.visit(_joined(name, str(key)), each, _setter(value, key))
        elif isinstance(value, (list, tuple, deque)):
            self.lengths[name] = len(value)
            for index, each in enumerate(value):
                self.visit(_joined(name, str(index)), each, _setter(value, index))
        elif isinstance(value, random.Random) or not (hasattr(value, "__dict__") or hasattr(value, "__slots__")):
            raise StateError(
                f"'{name}' is a {type(value).__name__}, which the harness cannot save; use a tensor, a number or a list"
            )
        else:
            slots = [each for kind in type(value).__mro__ for each in getattr(kind, "__slots__", ())]
            held = {each: getattr(value, each) for each in slots if hasattr(value, each)}
            self.attributes(name, value, {**held, **getattr(value, "__dict__", {})})

    def attributes(self, name: str, owner: Any, attributes: Mapping[str, Any]) -> None:
        """Walk an object's attributes."""
        for key, each in list(attributes.items()):
            self.visit(_joined(name, key.lstrip("_")), each, _attribute_setter(owner, key))

    def _module(self, name: str, module: torch.nn.Module) -> None:
        if isinstance(module, (torch.nn.ModuleList, torch.nn.ParameterList)):
            self.lengths[name] = len(module)
        for parts in (module._parameters, module._buffers, module._modules):
            for key, each in parts.items():
                if each is not None:
                    self.visit(_joined(name, key), each, _attribute_setter(module, key))
        own = {key: each for key, each in vars(module).items() if key not in _of_modules()}
        self.attributes(name, module, own)

    def _optimizer(self, name: str, optimizer: torch.optim.Optimizer) -> list[tuple[str, Tensor]]:
        self.lengths[f"{name}.groups"] = len(optimizer.param_groups)
        parameters = []
        for index, group in enumerate(optimizer.param_groups):
            for key, each in group.items():
                if key != "params":
                    self.visit(f"{name}.groups.{index}.{key}", each, _setter(group, key))
            for place, parameter in enumerate(group["params"]):
                owner = self._names.get(id(parameter))
                if owner is None:  # only the optimiser holds it, or it is a view of what the method holds
                    owner = f"{name}.groups.{index}.parameters.{place}"
                    self.tensor(owner, parameter)
                parameters.append((owner, parameter))
                for key, each in optimizer.state.get(parameter, {}).items():
                    self.visit(f"{owner}@{name}.{key}", each, _setter(optimizer.state[parameter], key))
        return parameters


def _joined(name: str, part: str) -> str:
    return f"{name}.{part}" if name and part else name or part


def _setter(container: Any, key: Any) -> Callable[[Any], None]:
    def put(new: Any) -> None:
        container[key] = new

    return put


def _generator_setter(generator: torch.Generator) -> Callable[[Any], None]:
    def put(new: Any) -> None:
        generator.set_state(new)

    return put


def _attribute_setter(owner: Any, key: str) -> Callable[[Any], None]:
    return lambda new: setattr(owner, key, new)


def held_tensors(method: Method) -> dict[str, Tensor]:
    """Every tensor that a method holds, whatever a `state` of its own returns."""
    walk = _Walk()
    walk.attributes("", method, {name: value for name, value in vars(method).items() if name != "config"})
    return {name: leaf.value for name, leaf in walk.finish().leaves.items() if isinstance(leaf.value, torch.Tensor)}


def _walked(method: Method) -> _Walked:
    walk = _Walk()
    own = method.state()
    if own is None:
        walk.attributes("", method, {name: value for name, value in vars(method).items() if name != "config"})
    else:
        for name, tensor in own.items():
            walk.tensor(name, tensor)
    return walk.finish()


def live_tensors(method: Method) -> dict[str, Tensor]:
    """Every tensor that a method's state is made of, by name: ``policy.network``, ``value_optimizer.exp_avg``."""
    return {name: leaf.value for name, leaf in _walked(method).leaves.items() if isinstance(leaf.value, torch.Tensor)}


def plain_values(method: Method) -> dict[str, Any]:
    """A copy of every plain value that a method's state has, by name."""
    return {
        name: copy.deepcopy(leaf.value)
        for name, leaf in _walked(method).leaves.items()
        if not isinstance(leaf.value, torch.Tensor)
    }


@dataclass(frozen=True)
class StateLayout:
    """Which leaves of a method belong to a seed.

    Attributes:
        lists: names of lists with an entry per seed.
        tensors: names of tensors, with a `*` for the index in such a list.
        stacked: those whose rows are the seeds'.
        values: names of plain values.
        infinite: names of tensors that hold numbers that are not finite before training, such as masks.
    """

    lists: frozenset[str]
    tensors: frozenset[str] = frozenset()
    stacked: frozenset[str] = frozenset()
    values: frozenset[str] = frozenset()
    infinite: frozenset[str] = frozenset()

    def place(self, name: str) -> tuple[str, int | None]:
        """The name of a leaf with a `*` for a seed's index, and that index; None where it is no seed's own."""
        if "@" in name:  # an optimiser's state, named after the parameter and the optimiser
            parameter, _, optimizer = name.partition("@")
            (parameter, seed), (optimizer, other) = self.place(parameter), self.place(optimizer)
            return f"{parameter}@{optimizer}", other if seed is None else seed
        parts, seed = name.split("."), None
        for end in range(1, len(parts)):
            if seed is None and ".".join(parts[:end]) in self.lists and parts[end].isdigit():
                seed, parts[end] = int(parts[end]), PER_SEED
        return ".".join(parts), seed


def state_layout(method: type[Method], config: Any, shapes: Shapes) -> StateLayout:
    """Build the method for one seed and for two, on the CPU, and see what doubles.

    Raises:
        StateError: a tensor that is neither the same for all seeds nor has rows for each of them.
    """
    one, two = (_walked(method(config, shapes, seeds, host())) for seeds in ((0,), (0, 1)))
    lists = frozenset(name for name, length in one.lengths.items() if (length, two.lengths.get(name)) == (1, 2))
    layout = StateLayout(lists)
    single = {layout.place(name)[0]: leaf for name, leaf in one.leaves.items()}
    double = {layout.place(name)[0]: leaf for name, leaf in two.leaves.items()}
    if differing := single.keys() ^ double.keys():
        raise StateError(
            f"'{min(differing)}' exists with {'one seed' if min(differing) in single else 'two seeds'} only; "
            "hold one thing for all seeds, or a list with one per seed"
        )
    tensors = {name: leaf for name, leaf in single.items() if isinstance(leaf.value, torch.Tensor)}
    stacked = set()
    for name, leaf in tensors.items():
        if leaf.value.shape == double[name].value.shape:
            continue
        rows, twice = leaf.value.shape, double[name].value.shape
        if len(rows) != len(twice) or not rows or (2 * rows[0], *rows[1:]) != tuple(twice):
            raise StateError(
                f"'{name}' has shape {list(rows)} with one seed and {list(twice)} with two; "
                "its first axis must be the seeds', or its shape must not depend on them"
            )
        stacked.add(name)
    infinite = frozenset(name for name, leaf in tensors.items() if not torch.isfinite(leaf.value).all())
    values = frozenset(single.keys() - tensors.keys())
    return StateLayout(lists, frozenset(tensors), frozenset(stacked), values, infinite)


class MethodState:
    """A method's live state, by seed.

    Args:
        method: whose state it is.
        seeds: length of its seed axis.
        layout: of its class, configuration and shapes.
    """

    def __init__(self, method: Method, seeds: int, layout: StateLayout) -> None:
        self.method, self._seeds, self._layout = method, seeds, layout

    @classmethod
    def of(cls, method: Method, shapes: Shapes, seeds: int) -> MethodState:
        """The state of a method that was built for `shapes`.

        Raises:
            StateError: as `state_layout`.
        """
        return cls(method, seeds, state_layout(type(method), method.config, shapes))

    def capture(self, device: torch.device | None = None) -> list[SeedState]:
        """A copy of the state as it is now, per seed; on `device` where one is given.

        Raises:
            StateError: something began to exist during training.
        """
        states = [SeedState() for _ in range(self._seeds)]
        for name, seed, leaf in self._leaves():
            value = leaf.value
            if isinstance(value, torch.Tensor):
                value = value.detach().to(device or value.device, copy=True)
                for index in range(self._seeds) if seed is None else (seed,):
                    states[index].tensors[name] = value if seed is not None else self._share(name, value, index)
            else:
                for index in range(self._seeds) if seed is None else (seed,):
                    states[index].values[name] = self._share_of_list(name, copy.deepcopy(value), index)
        return states

    def restore(self, states: Sequence[SeedState], *, whole: bool = True) -> None:
        """Put captured states, one per seed of this method, into it; what parts of a state lack stays as it is.

        Args:
            states: one per seed.
            whole: refuse states that lack something.

        Raises:
            StateError: they do not fit; the method may then hold parts of them.
        """
        if len(states) != self._seeds:
            raise StateError(f"there are {len(states)} states for {self._seeds} seeds")
        self._materialize(states)
        found = set()
        saved = {name for state in states for name in (*state.tensors, *state.values)}
        for name, seed, leaf in self._leaves():
            if name not in saved and not whole:
                continue
            try:
                if isinstance(leaf.value, torch.Tensor):
                    leaf.put(self._assembled(name, seed, [state.tensors for state in states], leaf.value))
                else:
                    value = self._assembled_value(name, seed, [state.values for state in states])
                    if value != leaf.value:  # a constant need not be replaceable
                        leaf.put(value)
            except (AttributeError, KeyError, RuntimeError, TypeError, ValueError) as error:
                raise StateError(f"the saved '{name}' does not fit: {error}") from error
            found.add(name)
        if unknown := saved - found:
            raise StateError(f"the method has no '{min(unknown)}'")

    def finite(self) -> Tensor:
        """``[S]``; False for a seed that holds a number that is not finite, and for all if what they share is NaN."""
        flags: list[list[Tensor]] = [[] for _ in range(self._seeds)]
        rows: list[Tensor] = []
        for name, seed, leaf in self._leaves():
            if not isinstance(leaf.value, torch.Tensor) or not leaf.value.is_floating_point():
                continue
            if name in self._layout.infinite:
                continue
            if seed is not None:
                flags[seed].append(torch.isfinite(leaf.value).all())
            elif self._is_stacked(name):
                rows.append(torch.isfinite(leaf.value).reshape(self._seeds, -1).all(-1))
            else:
                rows.append(~torch.isnan(leaf.value).any().expand(self._seeds))
        own = [torch.stack([flag.cpu() for flag in each]).all() for each in flags if each]
        result = torch.ones(self._seeds, dtype=torch.bool)
        if rows:
            result &= torch.stack([each.cpu() for each in rows]).all(0)
        return result & torch.stack(own) if own else result

    def _leaves(self) -> Iterator[tuple[str, int | None, _Leaf]]:
        for leaf in _walked(self.method).leaves.values():
            name, seed = self._layout.place(leaf.name)
            known = self._layout.tensors if isinstance(leaf.value, torch.Tensor) else self._layout.values
            if "@" not in name and name not in known:
                raise StateError(f"'{leaf.name}' began to exist during training; create it in __init__")
            yield name, seed, leaf

    def _is_stacked(self, name: str) -> bool:
        # What an optimiser keeps of a parameter is shaped as the parameter, or is a count.
        return name.partition("@")[0] in self._layout.stacked

    def _share(self, name: str, tensor: Tensor, index: int) -> Tensor:
        if not self._is_stacked(name) or tensor.dim() == 0:
            return tensor
        rows = len(tensor) // self._seeds
        return tensor[index * rows : (index + 1) * rows].clone()

    def _share_of_list(self, name: str, value: Any, index: int) -> Any:
        return value[index] if name in self._layout.lists else value

    def _assembled(self, name: str, seed: int | None, states: Sequence[Mapping[str, Tensor]], live: Tensor) -> Tensor:
        if seed is not None:
            found = states[seed][name]
        elif self._is_stacked(name) and live.dim() > 0:
            found = torch.cat([state[name] for state in states])
        else:
            found = states[0][name]
        if found.shape != live.shape or found.dtype != live.dtype:
            raise ValueError(f"{list(found.shape)} of {found.dtype} for {list(live.shape)} of {live.dtype}")
        return found

    def _assembled_value(self, name: str, seed: int | None, states: Sequence[Mapping[str, Any]]) -> Any:
        if name in self._layout.lists:
            return [state[name] for state in states]
        return states[seed or 0][name]

    def _materialize(self, states: Sequence[SeedState]) -> None:
        """Let optimisers that have not stepped yet hold what the states hold of them: torch creates it in a step."""
        for name, optimizer, parameters in _walked(self.method).optimizers:
            for owner, parameter in parameters:
                prefix, seed = self._layout.place(f"{owner}@{name}.")
                held, saved = optimizer.state[parameter], states[seed or 0]
                for key in (key for key in saved.tensors if key.startswith(prefix)):
                    tensor = saved.tensors[key]
                    empty = tensor.clone() if tensor.dim() == 0 else torch.zeros_like(parameter, dtype=tensor.dtype)
                    held.setdefault(key.removeprefix(prefix), empty)
                for key in (key for key in saved.values if key.startswith(prefix)):
                    held.setdefault(key.removeprefix(prefix), saved.values[key])
