"""Labels of offline transitions, computed once by a method from whole trajectories behind the same firewall as batches.

A method gets the trajectories that its batches are rows of: no rewards, no expert actions without access, offline
trajectories in an order that hides their origin. Its labels are cached under a hash of everything that they may
depend on.
"""

from __future__ import annotations

import hashlib
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch

from lfobench.contract.episodes import BoolArray, IntArray
from lfobench.contract.method import DataNeeds, Method, Trajectories, UnsuitableData
from lfobench.data.boundaries import Rows
from lfobench.data.mixing import Mixture
from lfobench.errors import UserError
from lfobench.randomness import Randomness
from lfobench.tensor_files import DamagedFile, read_tensors, write_tensors
from lfobench.text import content_hash

if TYPE_CHECKING:
    from torch import Tensor

FORMAT = 1
LABEL = "label"
DROPPED_AT_THE_END = 2
"""Steps that boundary rules drop at the end of an episode of which they keep every other step."""


@dataclass(frozen=True)
class _Runs:
    """Successive steps of one episode each, as indices into the mixture.

    Attributes:
        first_observation: ``[E]``.
        first_action: ``[E]``.
        lengths: ``[E]`` steps.
        terminated: ``[E]``.
    """

    first_observation: IntArray
    first_action: IntArray
    lengths: IntArray
    terminated: BoolArray

    @property
    def actions(self) -> IntArray:
        """``[N]``."""
        return _ranges(self.first_action, self.lengths)

    def ordered(self, order: IntArray) -> _Runs:
        """The same runs in another order ``[E]``."""
        return _Runs(
            self.first_observation[order], self.first_action[order], self.lengths[order], self.terminated[order]
        )


def labels_of(
    method: type[Method],
    config: Any,
    needs: DataNeeds,
    mixture: Mixture,
    seeds: Sequence[int],
    device: torch.device,
    code: Mapping[str, str],
    cache: Path,
    progress: Callable[[float], None],
) -> Tensor | None:
    """Labels by action: ``[A]``, or ``[S, A]`` where they differ between seeds; None for a method that asks for none.

    Args:
        method: whose `prepare` makes them, unless they are cached.
        config: of the method.
        needs: its declaration.
        mixture: the data.
        seeds: the seed axis.
        device: where `prepare` computes.
        code: hashes of the method's source files.
        cache: root of the dataset cache.
        progress: called with the fraction done; may raise.

    Raises:
        UserError: data that the method refuses, labels of another shape than the transitions', or not finite.
    """
    if LABEL not in needs.offline:
        return None
    runs = _runs(mixture.offline, mixture)
    # A random order that depends on the whole data only, as that of the rows.
    randomness = Randomness([zlib.crc32(np.ascontiguousarray(mixture.actions).data)])
    runs = runs.ordered(randomness.permutation("order of the trajectories", 0, len(runs.lengths))[0].numpy())
    offline = _trajectories(runs, mixture, "action" in needs.offline, device)
    expert = _trajectories(_runs(mixture.expert, mixture), mixture, "action" in needs.expert, device)
    key = content_hash(
        {
            "format": FORMAT,
            "method": [method.name, method.version, dict(code)],
            "config": config.model_dump(mode="json"),
            "data": [_hash(part) for part in (offline, expert)],
            "device": device.type,
            "torch": torch.__version__,
        }
    )
    found = _cached(cache, key, seeds)
    if found is None:
        try:
            found = method.prepare(config, offline, expert, seeds, progress)
        except UnsuitableData as error:
            raise UserError(str(error), error.remedy) from error
        _check(method, found, len(runs.actions), len(seeds))
        _keep(cache, key, seeds, found)
    labels = torch.full((*found.shape[:-1], len(mixture.actions)), torch.nan)
    labels[..., torch.from_numpy(runs.actions)] = found.detach().float().cpu()
    return labels


def _runs(rows: Rows, mixture: Mixture) -> _Runs:
    """The longest runs of successive steps in `rows`; whole episodes but for the steps that boundary rules drop."""
    lengths = mixture.lengths
    first = np.concatenate(([0], np.cumsum(lengths)[:-1])).astype(np.int64)
    episode = np.repeat(np.arange(len(lengths)), lengths)
    held = np.zeros(len(episode) + 1, np.bool_)
    held[rows.action] = True
    starts = held[:-1] & ~(np.roll(held, 1)[:-1] & (np.arange(len(episode)) != first[episode]))
    begin = np.flatnonzero(starts)
    # A stretch ends where the next step is not held, or is another episode's.
    last = np.concatenate((episode[1:] != episode[:-1], [True]))
    end = np.flatnonzero(held[:-1] & (last | ~held[1:])) + 1
    of = episode[begin]
    whole = first[of] + lengths[of]
    complete = (begin == first[of]) & (end >= whole - DROPPED_AT_THE_END)
    end = np.where(complete, whole, end)
    return _Runs(begin + of, begin, end - begin, mixture.terminated[of] & (end == whole))


def _trajectories(runs: _Runs, mixture: Mixture, actions: bool, device: torch.device) -> Trajectories:
    observations = mixture.observations[_ranges(runs.first_observation, runs.lengths + 1)]
    return Trajectories(
        observations=torch.from_numpy(observations).to(device),
        actions=torch.from_numpy(mixture.actions[runs.actions]).to(device) if actions else None,
        lengths=torch.from_numpy(runs.lengths).to(device),
        terminated=torch.from_numpy(runs.terminated).to(device),
    )


def _ranges(first: IntArray, lengths: IntArray) -> IntArray:
    """``first[0], first[0] + 1, …, first[1], …``: `lengths` successive numbers from each."""
    before = np.concatenate(([0], np.cumsum(lengths)[:-1]))
    ranges: IntArray = np.arange(int(lengths.sum())) + np.repeat(first - before, lengths)
    return ranges


def _check(method: type[Method], labels: object, transitions: int, seeds: int) -> None:
    shapes = ((transitions,), (seeds, transitions))
    if not isinstance(labels, torch.Tensor) or tuple(labels.shape) not in shapes:
        found = f"of shape {list(labels.shape)}" if isinstance(labels, torch.Tensor) else f"a {type(labels).__name__}"
        raise UserError(
            f"Method '{method.name}': `prepare` returned {found}; a tensor {list(shapes[0])} or {list(shapes[1])} "
            "has one label per offline transition.",
            "Return a label for every step of every trajectory, in their order.",
        )
    if not torch.isfinite(labels).all():
        raise UserError(
            f"Method '{method.name}': `prepare` returned labels that are not finite.",
            "The last observation of a trajectory is NaN where the data does not hold it.",
        )


def _cached(cache: Path, key: str, seeds: Sequence[int]) -> Tensor | None:
    try:
        return read_tensors(_path(cache, key, None))[0][LABEL]
    except (DamagedFile, FileNotFoundError, KeyError):
        pass
    try:
        return torch.stack([read_tensors(_path(cache, key, seed))[0][LABEL] for seed in seeds])
    except (DamagedFile, FileNotFoundError, KeyError):
        return None


def _keep(cache: Path, key: str, seeds: Sequence[int], labels: Tensor) -> None:
    parts = {None: labels} if labels.dim() == 1 else dict(zip(seeds, labels, strict=True))
    for seed, part in parts.items():
        write_tensors(_path(cache, key, seed), {LABEL: part.detach().float().cpu().clone()}, {"key": key, "seed": seed})


def _path(cache: Path, key: str, seed: int | None) -> Path:
    return cache / "labels" / f"{key[:24]}{'' if seed is None else f'-seed{seed}'}.safetensors"


def _hash(part: Trajectories) -> str:
    digest = hashlib.sha256()
    for tensor in (part.observations, part.actions, part.lengths, part.terminated):
        if tensor is not None:
            digest.update(str(list(tensor.shape)).encode())
            digest.update(tensor.cpu().contiguous().numpy().data)
    return digest.hexdigest()
