"""Switching on the number type of matrix products."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import torch

from lfobench.contract.record import Warning
from lfobench.plan.precision import Precision, effective

# As /proc/cpuinfo names them on x86 and on ARM.
BF16_UNITS = ("avx512_bf16", "amx_bf16", "bf16")


@contextmanager
def products(precision: Precision, device: torch.device) -> Iterator[None]:
    """Products of that precision inside the block."""
    kind = effective(precision, device.type)
    if device.type == "cuda":
        torch.backends.cuda.matmul.allow_tf32 = kind == "tf32"
    if kind != "bf16":
        yield
        return
    # Autocast's cache of converted weights would outlive the step that changes them.
    with torch.autocast(device.type, torch.bfloat16, cache_enabled=False):
        yield


def precision_warnings(precision: Precision, device: torch.device) -> list[Warning]:
    """What a user should know about a precision on this machine."""
    if precision != "bf16" or device.type != "cpu" or has_bf16_units():
        return []
    return [
        Warning(
            what="This processor has no bf16 matrix units, so bf16 products are emulated.",
            remedy="float32 is faster here.",
        )
    ]


def has_bf16_units() -> bool:
    """Whether the processor multiplies bf16 matrices in hardware."""
    try:
        flags = Path("/proc/cpuinfo").read_text(encoding="utf-8").split()
    except OSError:
        return True
    return any(unit in flags for unit in BF16_UNITS)
