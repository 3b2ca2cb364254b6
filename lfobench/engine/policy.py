"""Trained policies on disk: what is kept of a run beside its record, and how it acts again."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from pydantic import ValidationError

from lfobench.contract.episodes import FloatArray
from lfobench.contract.method import Method, Shapes
from lfobench.data.firewall import View
from lfobench.data.mixing import ObservationTransform
from lfobench.engine.state import MethodState, SeedState, StateError, host
from lfobench.errors import UserError
from lfobench.record import Record
from lfobench.records.folder import RecordFolder
from lfobench.registry import load_method
from lfobench.source_code import code_of
from lfobench.tensor_files import DamagedFile, read_tensors, write_tensors

SHIFT, SCALE = "observation transform: shift", "observation transform: scale"
"""Names that no attribute of a method can have."""

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
        """Actions ``[n, act]`` in [-1, 1] for the simulator's observations ``[n, obs]``."""
        seen = torch.from_numpy(self.transform(observation))[None]
        with torch.no_grad():
            actions: FloatArray = self.method.act(seen)[0].numpy()
        return actions


def save_policy(path: Path, record: Record, method: type[Method], trained: MethodState, index: int, seen: View) -> None:
    """Keep the policy of one of a method's seeds: of its state no more than acting takes.

    Args:
        path: the file.
        record: of the run.
        method: its class.
        trained: the state of all seeds.
        index: of the seed on its axis.
        seen: what the method was trained on.

    Raises:
        UserError: when the disk refuses.
    """
    state = trained.capture(host())[index]
    transform, shapes = seen.transform, seen.shapes
    kept = _acting(method, record, shapes, transform, state)
    tensors = {**kept.tensors, SHIFT: torch.from_numpy(transform.shift), SCALE: torch.from_numpy(transform.scale)}
    about = {
        "identity_hash": record.identity_hash,
        "observation": shapes.observation,
        "action": shapes.action,
        "indicator": transform.indicator,
        "values": kept.values,
    }
    write_tensors(path, tensors, about)


def load_policy(folder: RecordFolder, record: Record) -> TrainedPolicy:
    """The policy that a run left.

    Raises:
        UserError: when its file is missing, damaged or another run's, or the method's code is not what it was.
    """
    known = _known(record)
    path = folder.policy(record)
    again = f"Train {record.method} on {record.task} anew: lfobench run --rerun."
    try:
        tensors, about = read_tensors(path)
        if about["identity_hash"] != record.identity_hash:
            raise ValueError("it is another run's")
        transform = ObservationTransform(
            tensors.pop(SHIFT).numpy(), tensors.pop(SCALE).numpy(), bool(about["indicator"])
        )
        shapes, state = Shapes(about["observation"], about["action"]), SeedState(tensors, about["values"])
        method = _restored(known, record, shapes, state)
    except FileNotFoundError as error:
        raise UserError(f"The trained policy {path} is not there.", again) from error
    except (DamagedFile, StateError, OSError, ValueError, KeyError, TypeError, RuntimeError) as error:
        raise UserError(f"The trained policy {path} cannot be used ({error}).", again) from error
    return TrainedPolicy(method, transform)


def _known(record: Record) -> type[Method]:
    """The method of a record, as it was when it was trained."""
    code = record.identity.get("method_code")
    try:
        known = load_method(record.method)
    except UserError as error:
        remedy = "If it stands in a file, give the file's path in the place of its name." if code else error.remedy
        raise UserError(error.problem, remedy) from error
    if code and code != code_of(known):
        problem = f"Method '{record.method}' was edited after it was trained on {record.task}."
        raise UserError(problem, "Train it as it is now: lfobench run.")
    return known


def _restored(known: type[Method], record: Record, shapes: Shapes, state: SeedState) -> Method:
    """A method of one seed, on the CPU, with as much of its state as there is."""
    try:
        config = known.Config.model_validate(record.identity["config"])
    except ValidationError as error:
        raise ValueError(f"{record.method} does not know its configuration any more") from error
    method: Method = known(config, shapes, [record.seed], host())
    MethodState.of(method, shapes, 1).restore([state], whole=False)
    return method


def _acting(
    method: type[Method], record: Record, shapes: Shapes, transform: ObservationTransform, state: SeedState
) -> SeedState:
    """The part of a seed's state that its actions depend on: spoiling any of its tensors spoils an action."""
    probe = torch.from_numpy(transform(_probes(transform)))[None]
    acting = _restored(method, record, shapes, state)
    live = MethodState.of(acting, shapes, 1)
    with torch.no_grad():
        intact = acting.act(probe).clone()

        def same(other: Method) -> bool:
            return torch.allclose(other.act(probe), intact, rtol=0.0, atol=0.0, equal_nan=True)

        kept = {}
        for name, tensor in state.tensors.items():
            if tensor.is_floating_point():
                live.restore([SeedState({name: torch.full_like(tensor, torch.nan)})], whole=False)
                spoilt = not same(acting)
                live.restore([SeedState({name: tensor})], whole=False)
            else:
                spoilt = True
            if spoilt:
                kept[name] = tensor
        part = SeedState(kept, state.values)
        # A choice between branches can hide what is not finite.
        return part if same(_restored(method, record, shapes, part)) else state


def _probes(transform: ObservationTransform) -> FloatArray:
    """Observations about where the data lies."""
    spread = np.random.default_rng(0).standard_normal((PROBES, len(transform.shift)))
    return np.asarray(transform.shift + transform.scale * spread, np.float32)
