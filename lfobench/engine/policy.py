"""Trained policies on disk: what is kept of a run beside its record, and how it acts again."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from pydantic import ValidationError
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from lfobench.contract.episodes import FloatArray
from lfobench.contract.method import Method, Shapes
from lfobench.contract.record import Record
from lfobench.data.firewall import View
from lfobench.data.mixing import ObservationTransform
from lfobench.errors import UserError
from lfobench.files import replacing
from lfobench.registry import load_method
from lfobench.store.folder import RecordFolder

CPU = torch.device("cpu")
SHIFT, SCALE = "transform.shift", "transform.scale"
PROBES = 8


@dataclass(frozen=True)
class TrainedPolicy:
    """One run's policy.

    Attributes:
        method: of a single seed, on the CPU.
        transform: from the simulator's observation to the method's.
    """

    method: Method
    transform: ObservationTransform

    def act(self, observation: FloatArray) -> FloatArray:
        """Actions ``[n, act]`` for the simulator's observations ``[n, obs]``."""
        seen = torch.from_numpy(self.transform(observation))[None]
        with torch.no_grad():
            actions: FloatArray = self.method.act(seen)[0].numpy()
        return actions


def save_policy(path: Path, record: Record, method: Method, index: int, seeds: int, seen: View) -> None:
    """Keep the policy of one of a method's seeds: of its state no more than acting takes.

    Args:
        path: the file.
        record: of the run.
        method: trained.
        index: of the seed on its axis.
        seeds: length of that axis.
        seen: what the method was trained on.

    Raises:
        UserError: when the disk refuses.
    """
    state = {name: _share(tensor, index, seeds) for name, tensor in method.state().items()}
    policy = {name: tensor for name, tensor in state.items() if _acts(name)}
    transform, shapes = seen.transform, seen.shapes
    probe = torch.from_numpy(transform(_probes(transform)))[None]
    whole, part = (_restored(type(method), record, shapes, tensors).act(probe) for tensors in (state, policy))
    # A method from outside may act by other tensors than those named after the policy.
    kept = policy if torch.allclose(part, whole, rtol=0.0, atol=0.0, equal_nan=True) else state
    tensors = {**kept, SHIFT: torch.from_numpy(transform.shift), SCALE: torch.from_numpy(transform.scale)}
    sizes = {"observation": shapes.observation, "action": shapes.action, "indicator": transform.indicator}
    metadata = {"identity_hash": record.identity_hash, "shapes": json.dumps(sizes)}
    with replacing(path) as temporary:
        save_file({name: tensor.contiguous() for name, tensor in tensors.items()}, temporary, metadata)


def load_policy(folder: RecordFolder, record: Record) -> TrainedPolicy:
    """The policy that a run left.

    Raises:
        UserError: when its file is missing, damaged or another run's.
    """
    path = folder.policy(record)
    again = f"Delete the run's record and issue 'lfobench run' again, to train {record.method} on {record.task} anew."
    try:
        with safe_open(path, framework="pt") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.offset_keys()}
        if metadata["identity_hash"] != record.identity_hash:
            raise ValueError("it is another run's")
        sizes = json.loads(metadata["shapes"])
        transform = ObservationTransform(
            tensors.pop(SHIFT).numpy(), tensors.pop(SCALE).numpy(), bool(sizes["indicator"])
        )
        method = _restored(load_method(record.method), record, Shapes(sizes["observation"], sizes["action"]), tensors)
    except FileNotFoundError as error:
        raise UserError(f"The trained policy {path} is not there.", again) from error
    except (SafetensorError, OSError, ValueError, KeyError, TypeError, RuntimeError) as error:
        raise UserError(f"The trained policy {path} cannot be used ({error}).", again) from error
    return TrainedPolicy(method, transform)


def _restored(known: type[Method], record: Record, shapes: Shapes, tensors: Mapping[str, Tensor]) -> Method:
    try:
        config = known.Config.model_validate(record.identity["config"])
    except ValidationError as error:
        raise ValueError(f"{record.method} does not know its configuration any more") from error
    method: Method = known(config, shapes, [record.seed], CPU)
    own = method.state()
    for name, tensor in tensors.items():
        if name not in own or own[name].shape != tensor.shape:
            raise ValueError(f"{record.method} has no '{name}' of shape {list(tensor.shape)}")
        own[name].copy_(tensor)
    return method


def _acts(name: str) -> bool:
    """Whether a tensor's name says that it is a policy's own, by the field's two words for one."""
    return name.split(".")[0] in ("policy", "actor") and ".adam" not in name


def _share(tensor: Tensor, index: int, seeds: int) -> Tensor:
    """One seed's part of a state tensor, on the host."""
    tensor = tensor.detach().to(CPU)
    if tensor.dim() == 0:
        return tensor.clone()
    rows = len(tensor) // seeds
    return tensor[index * rows : (index + 1) * rows].clone()


def _probes(transform: ObservationTransform) -> FloatArray:
    """Observations about where the data lies."""
    spread = np.random.default_rng(0).standard_normal((PROBES, len(transform.shift)))
    return np.asarray(transform.shift + transform.scale * spread, np.float32)
