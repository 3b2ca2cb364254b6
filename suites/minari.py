"""Datasets of Minari, by their identifiers. They are data of their own, or ports; never call one a D4RL file."""

from __future__ import annotations

from lfobench.contract.suite import DataFile


def dataset(identifier: str, columns: int | None = None) -> DataFile:
    """``mujoco/hopper/medium-v0``."""
    return DataFile(identifier.replace("/", "-"), (f"minari:{identifier}",), columns=columns)
