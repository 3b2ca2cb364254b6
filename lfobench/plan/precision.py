"""The number type of matrix products, as asked for and as a device understands it.

Parameters, optimiser and losses are float32 throughout; only products differ. TF32 keeps float32's range and 10 bits of
its fraction, and is what the authors' torch used on GPUs without saying so (methods.md 8); bf16 keeps 7 bits.
"""

from __future__ import annotations

from typing import Literal, cast, get_args

from lfobench.errors import UserError, unknown_name

Precision = Literal["auto", "float32", "tf32", "bf16"]


def check_precision(name: str, device: str) -> Precision:
    """A precision that exists on the device.

    Raises:
        UserError: for an unknown name, or TF32 off CUDA.
    """
    if name not in get_args(Precision):
        raise unknown_name("precision", name, get_args(Precision))
    if name == "tf32" and device != "cuda":
        raise UserError("TF32 products exist on CUDA devices only.", "Use --precision auto, float32 or bf16.")
    return cast(Precision, name)


def effective(precision: Precision, device: str) -> Precision:
    """What ``auto`` means: TF32 on CUDA, float32 elsewhere."""
    if precision != "auto":
        return precision
    return "tf32" if device == "cuda" else "float32"
