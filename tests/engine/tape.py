"""A CUDA graph for a CPU: records the operations of some work without carrying them out, and repeats them later.

It keeps what matters of a graph. Python runs once; whatever it decided is decided for ever. Inputs and outputs are the
memory they were, so only what is changed in place survives a replay. An operation that would make the host wait for the
device, or hand it a number, cannot be recorded.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_flatten, tree_unflatten

WAITING = {"_local_scalar_dense", "item", "nonzero", "is_nonzero", "equal", "masked_select", "unique_dim", "_unique2"}
FROM_HOST = {"lift_fresh", "lift_fresh_copy"}


class _Log(TorchDispatchMode):
    def __init__(self) -> None:
        super().__init__()
        self.calls: list[tuple[Any, tuple[Any, ...], dict[str, Any], Any]] = []
        self.before: dict[object, tuple[Tensor, Tensor]] = {}

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        kwargs = kwargs or {}
        name = func.overloadpacket.__name__
        if name in WAITING or name in FROM_HOST:
            raise RuntimeError(f"operation not permitted while recording: {name}")
        if name in ("index", "index_put_") and any(t is not None and t.dtype == torch.bool for t in args[1]):
            raise RuntimeError("operation not permitted while recording: an index of booleans")
        arguments = dict(zip((a.name for a in func._schema.arguments), args, strict=False)) | kwargs
        for argument in func._schema.arguments:
            if argument.alias_info is not None and argument.alias_info.is_write:
                for tensor in tree_flatten(arguments.get(argument.name))[0]:
                    self._keep(tensor)
        out = func(*args, **kwargs)
        self.calls.append((func, args, kwargs, out))
        return out

    def _keep(self, tensor: Tensor) -> None:
        place = (tensor.data_ptr(), tensor.shape, tensor.stride())
        if place not in self.before:
            self.before[place] = (tensor, tensor.clone())

    def undo(self) -> None:
        for tensor, value in reversed(list(self.before.values())):
            tensor.copy_(value)


def record(work: Callable[[], None]) -> Callable[[], None]:
    """See `lfobench.engine.program.Recorder`.

    Raises:
        RuntimeError: where a CUDA graph could not hold an operation.
    """
    log = _Log()
    try:
        with log:
            work()
    finally:
        with torch.no_grad():
            log.undo()

    calls = [_Call(*call) for call in log.calls]

    def replay() -> None:
        now: dict[int, Tensor] = {}
        with torch.no_grad():
            for call in calls:
                call.repeat(now)

    return replay


class _Call:
    """One operation: positional leaves that are tensors are looked up anew, the rest is as it was."""

    def __init__(self, func: Any, args: tuple[Any, ...], kwargs: dict[str, Any], out: Any) -> None:
        self._func = func
        self._leaves, self._spec = tree_flatten((args, kwargs))
        self._tensors = [place for place, leaf in enumerate(self._leaves) if isinstance(leaf, Tensor)]
        self._made = [id(leaf) if isinstance(leaf, Tensor) else None for leaf in tree_flatten(out)[0]]
        self._kept = out  # so that no other tensor gets its id

    def repeat(self, now: dict[int, Tensor]) -> None:
        leaves = list(self._leaves)
        for place in self._tensors:
            leaves[place] = now.get(id(leaves[place]), leaves[place])
        args, kwargs = tree_unflatten(leaves, self._spec)
        new = self._func(*args, **kwargs)
        for name, made in zip(self._made, [new] if isinstance(new, Tensor) else tree_flatten(new)[0], strict=True):
            if name is not None:
                now[name] = made
