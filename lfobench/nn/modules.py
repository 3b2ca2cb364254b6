"""Ordinary modules, one per seed, called as one."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch
from torch import Tensor, nn


class PerSeed(nn.ModuleList):
    """A `torch.nn.Module` per seed; ``[S, B, in] -> [S, B, out]``.

    Slower than `lfobench.nn.networks.Network`, which multiplies all seeds at once, and as right: every module's initial
    weights are drawn from a generator of its seed alone, and no operation mixes seeds. A torch optimiser over
    ``parameters()`` treats every parameter by itself, so one serves all seeds; sum the losses ``[S]`` before
    ``backward()``. Anything that looks at all parameters at once, such as ``clip_grad_norm_``, has to be called per
    module.

    Args:
        build: makes one seed's module; called once for each.
        seeds: the seed axis.
        device: where the modules live.
    """

    def __init__(self, build: Callable[[], nn.Module], seeds: Sequence[int], device: torch.device) -> None:
        modules = []
        for seed in seeds:
            with torch.random.fork_rng(devices=[]):
                torch.manual_seed(seed)
                modules.append(build().to(device))
        super().__init__(modules)

    def forward(self, inputs: Tensor) -> Tensor:
        """Outputs ``[S, B, out]`` of inputs ``[S, B, in]``."""
        return torch.stack([module(rows) for module, rows in zip(self, inputs.unbind(), strict=True)])
