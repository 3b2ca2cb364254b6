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
from torch.utils._pytree import tree_flatten, tree_map_only

WAITING = {"_local_scalar_dense", "item", "nonzero", "is_nonzero", "equal", "masked_select", "unique_dim", "_unique2"}
FROM_HOST = {"lift_fresh", "lift_fresh_copy"}


class _Log(TorchDispatchMode):
    def __init__(self) -> None:
        super().__init__()
        self.calls: list[tuple[Any, tuple[Any, ...], dict[str, Any], Any]] = []
        self.made: set[int] = set()
        self.before: dict[int, tuple[Tensor, Tensor]] = {}

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
        self.made |= {id(each) for each in tree_flatten(out)[0] if isinstance(each, Tensor)}
        return out

    def _keep(self, tensor: Tensor) -> None:
        if tensor.data_ptr() not in self.before:
            self.before[tensor.data_ptr()] = (tensor, tensor.clone())

    def undo(self) -> None:
        for tensor, value in reversed(self.before.values()):
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

    def replay() -> None:
        now: dict[int, Tensor] = {}

        def current(tensor: Tensor) -> Tensor:
            return now.get(id(tensor), tensor)

        with torch.no_grad():
            for func, args, kwargs, out in log.calls:
                new = func(*tree_map_only(Tensor, current, args), **tree_map_only(Tensor, current, kwargs))
                for old, made in zip(tree_flatten(out)[0], tree_flatten(new)[0], strict=True):
                    if isinstance(old, Tensor):
                        now[id(old)] = made

    return replay
