"""BC as SMODICE's script ships it: entropy-constrained likelihood on the whole mix."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import nn

from benchmarks.authors.loop import HIDDEN, Batch, HostBuffer, HostData, Loop, TanhGaussian
from lfobench.contract.method import Shapes


class AuthorsBc(Loop):
    """Behavioural cloning of the offline data.

    Args:
        data: on the host.
        shapes: of observation and action.
        batch_size: offline rows.
        device: where the policy lives.
        hidden: widths.
    """

    def __init__(
        self, data: HostData, shapes: Shapes, batch_size: int, device: torch.device, hidden: Sequence[int] = HIDDEN
    ) -> None:
        self._offline = HostBuffer(data.offline, ("observation", "action"), device, np.random.default_rng(0))
        self._batch_size = batch_size
        self.policy = TanhGaussian(shapes, hidden, device)

    def sample(self) -> tuple[Batch, Batch]:
        """Offline rows."""
        return self._offline.sample(self._batch_size), {}

    def update(self, offline: Batch, expert: Batch) -> dict[str, float]:
        """One step of the policy."""
        self.policy.regress(offline["observation"], offline["action"])
        return {}

    def modules(self) -> dict[str, nn.Module]:
        """The policy."""
        return {"policy": self.policy}
