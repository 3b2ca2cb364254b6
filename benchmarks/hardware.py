"""The machine of a measurement: a line of text, JSON for the results file, a slug for its name."""

from __future__ import annotations

import os
import re
from dataclasses import asdict, dataclass
from typing import Any

import torch

from lfobench.engine.provenance import provenance


@dataclass(frozen=True)
class Hardware:
    """A machine as a benchmark's process sees it.

    Attributes:
        processor: model name.
        cores: logical processors that this process may use.
        gpu: name of the device that training runs on; None on a processor.
        threads: of torch.
        precision: number format of matrix products.
        torch: version, build included.
        python: version.
        operating_system: with its kernel.
        source_revision: commit, ``+changes`` if edited.
    """

    processor: str
    cores: int
    gpu: str | None
    threads: int
    precision: str
    torch: str
    python: str
    operating_system: str
    source_revision: str | None

    @property
    def name(self) -> str:
        """The device of the steps."""
        return self.gpu or self.processor

    @property
    def slug(self) -> str:
        """Part of a file name: lower-case letters, digits and hyphens."""
        threads = "" if self.gpu else f" {self.threads} thread{'s' if self.threads > 1 else ''}"
        return re.sub(r"[^a-z0-9]+", "-", (self.name + threads).lower()).strip("-")

    def __str__(self) -> str:
        where = f"{self.gpu} with {self.processor}" if self.gpu else self.processor
        cores = f"{self.cores} core{'s' if self.cores > 1 else ''}"
        threads = f"{self.threads} thread{'s' if self.threads > 1 else ''}"
        return f"{where} ({cores}, {threads}), {self.precision}, torch {self.torch}, {self.operating_system}"

    def as_json(self) -> dict[str, Any]:
        """JSON data."""
        return {"name": self.name, "slug": self.slug, **asdict(self)}


def describe(device: torch.device) -> Hardware:
    """The machine that this process runs on, `device` being where it trains."""
    host = provenance(torch.device("cpu"), "auto", {}, {})
    cuda = device.type == "cuda"
    return Hardware(
        processor=host["device"]["name"],
        cores=_usable_cores(),
        gpu=torch.cuda.get_device_name(device) if cuda else None,
        threads=torch.get_num_threads(),
        precision=_precision(cuda),
        torch=torch.__version__,
        python=host["python"],
        operating_system=host["platform"],
        source_revision=host["source_revision"],
    )


def _usable_cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def _precision(cuda: bool) -> str:
    reduced = cuda and torch.backends.cuda.matmul.allow_tf32
    return "float32, products in tensorfloat32" if reduced else "float32"
