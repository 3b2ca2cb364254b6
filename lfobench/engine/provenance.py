"""Provenance of a number: versions, machine, revision. Kept in the record, never part of its identity."""

from __future__ import annotations

import platform
import subprocess
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import torch

import lfobench
from lfobench.cells.cell import Precision, effective

PACKAGES = ("torch", "numpy", "gymnasium", "mujoco", "scipy", "lfobench")


@cache
def source_revision() -> str | None:
    """Commit of the checkout that the package runs from, ``+changes`` if it was edited; None outside git."""
    folder = Path(lfobench.__file__).parent
    try:
        revision = _git(folder, "rev-parse", "HEAD")
        tracked = _git(folder, "ls-files", "--error-unmatch", "__init__.py")
        changes = _git(folder, "status", "--porcelain", "--untracked-files=no", "--", ":/")
    except (OSError, subprocess.SubprocessError):
        return None
    return (revision + ("+changes" if changes else "")) if tracked else None


def _git(folder: Path, *arguments: str) -> str:
    command = ["git", "-C", str(folder), *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=10).stdout.strip()


def package_versions() -> dict[str, str]:
    """Installed versions of what the numbers rest on."""
    found = {}
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            continue
    return found


def provenance(
    device: torch.device, precision: Precision, seconds: dict[str, float], fingerprints: dict[str, str]
) -> dict[str, Any]:
    """Everything that a reader of the record may want to know about how it was made."""
    name = torch.cuda.get_device_name(device) if device.type == "cuda" else _processor_name()
    return {
        "finished_at": datetime.now(UTC).isoformat(timespec="seconds"),
        "seconds": {kind: round(value, 3) for kind, value in seconds.items()},
        "device": {
            "type": device.type,
            "name": name,
            "threads": torch.get_num_threads(),
            "precision": effective(precision, device.type),
        },
        "packages": package_versions(),
        "python": platform.python_version(),
        "platform": platform.platform(),
        "source_revision": source_revision(),
        "data_fingerprints": fingerprints,
    }


@cache
def _processor_name() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()
