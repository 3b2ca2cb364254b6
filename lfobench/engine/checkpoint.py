"""Checkpoints: everything that a killed job needs to continue bit for bit, in one file."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from pathlib import Path

import torch
from pydantic import BaseModel, ConfigDict
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from lfobench.contract.record import Evaluation, Metrics
from lfobench.files import replacing


class Progress(BaseModel):
    """Where a job stands; the part of a checkpoint that is not tensors.

    Attributes:
        stage: index of the running stage.
        step: updates of that stage done.
        evaluations: per seed, those done.
        metrics: per seed, the rows written.
        diverged_at: per seed, the step of the main stage at which it was found diverged, or None.
        seconds: time spent by all sittings so far, by kind; provenance only.
    """

    model_config = ConfigDict(extra="forbid")

    stage: int = 0
    step: int = 0
    evaluations: list[list[Evaluation]]
    metrics: list[list[Metrics]]
    diverged_at: list[int | None]
    seconds: dict[str, float]

    @classmethod
    def start(cls, seeds: int) -> Progress:
        """Nothing done yet."""
        return cls(
            evaluations=[[] for _ in range(seeds)],
            metrics=[[] for _ in range(seeds)],
            diverged_at=[None] * seeds,
            seconds={"train": 0.0, "evaluate": 0.0},
        )


def save(path: Path, job: str, progress: Progress, tensors: Mapping[str, Tensor]) -> None:
    """Write a checkpoint, whole or not at all.

    Raises:
        UserError: when the disk refuses.
    """
    contiguous = {name: tensor.detach().cpu().contiguous() for name, tensor in tensors.items()}
    with replacing(path) as temporary:
        metadata = {"job": job, "progress": progress.model_dump_json()}
        save_file(contiguous, temporary, {**metadata, "digest": _digest(contiguous, metadata)})


def load(path: Path, job: str, tensors: Mapping[str, Tensor]) -> tuple[Progress, dict[str, Tensor]] | None:
    """Copy a checkpoint of the same job into `tensors`; returns its progress and what else it holds.

    None when there is none that fits. A checkpoint that cannot be read or belongs to another job is as good as
    none: the run starts afresh, which costs time and changes no number.
    """
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            if metadata.get("job") != job or not set(tensors) <= set(file.keys()):
                return None
            loaded = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - not a dict
            progress = Progress.model_validate_json(metadata["progress"])
            if metadata.pop("digest", None) != _digest(loaded, metadata):
                return None
    except (OSError, SafetensorError, KeyError, ValueError):
        return None
    if any(loaded[name].shape != tensor.shape for name, tensor in tensors.items()):
        return None
    with torch.no_grad():
        for name, tensor in tensors.items():
            tensor.copy_(loaded.pop(name))
    return progress, loaded


def _digest(tensors: Mapping[str, Tensor], metadata: Mapping[str, str]) -> str:
    digest = hashlib.sha256(repr(sorted(metadata.items())).encode())
    for name in sorted(tensors):
        digest.update(name.encode())
        digest.update(tensors[name].numpy().tobytes())
    return digest.hexdigest()
