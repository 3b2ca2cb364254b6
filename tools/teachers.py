"""Teachers: Gaussian MLP policies, read from an ``.npz`` of plain arrays.

Layout: layers ``W0, b0, W1, b1, …`` (``Wi`` is ``[out, in]``) with activation ``hidden``, the last one
linear; ``logstd`` ``[act]``, or a head ``logstd_W`` ``[act, in]``, ``logstd_b`` ``[act]`` next to the last
layer; optionally ``obs_mean, obs_var, obs_eps, obs_clip`` (Stable-Baselines3) or ``in_shift, in_scale,
out_shift, out_scale`` (DAPG, https://github.com/aravindr93/hand_dapg); ``squash``: whether a tanh follows;
``meta``: JSON with the upstream ``source``, ``path`` and ``licence``.

The file is untrusted: arrays are read from it, never objects.
"""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from lfobench.contract.suite import FloatArray
from lfobench.errors import UserError

Array = NDArray[np.float64]

ACTIVATIONS = ("tanh", "relu")
PROVENANCE = ("source", "path", "licence")
DAPG_SCALE_EPSILON = 1e-8
# Stable-Baselines3's bounds on a log-std head.
LOG_STD_BOUNDS = (-20.0, 2.0)
MAX_BYTES = 64 * 2**20


@dataclass(frozen=True, eq=False)
class Teacher:
    """A Gaussian policy whose samples are bounded by tanh or by clipping.

    Attributes:
        weights: layers ``[out, in]``; the last one gives the Gaussian's mean.
        biases: their ``[out]``.
        log_std_weight: head ``[act, hidden]`` next to the last layer; zeros where the std is constant.
        log_std_bias: its ``[act]``.
        shift: ``[in]`` of the observation standardisation ``(x - shift) / scale``.
        scale: ``[in]``.
        clip: bound of a standardised observation.
        activation: ``tanh`` or ``relu``.
        squash: whether tanh bounds the sample; otherwise it is clipped to [-1, 1].
        provenance: where the policy comes from, for the card.
    """

    weights: tuple[Array, ...]
    biases: tuple[Array, ...]
    log_std_weight: Array
    log_std_bias: Array
    shift: Array
    scale: Array
    clip: float
    activation: str
    squash: bool
    provenance: Mapping[str, str]

    @property
    def inputs(self) -> int:
        """Number of observation columns that the first layer reads."""
        return int(self.weights[0].shape[1])

    @property
    def actions(self) -> int:
        """Number of action columns."""
        return int(self.weights[-1].shape[0])

    def calmed(self, factor: float) -> Teacher:
        """The same teacher with its exploration std multiplied by `factor`."""
        return replace(self, log_std_bias=self.log_std_bias + np.log(factor))

    def gaussian(self, observations: FloatArray) -> tuple[Array, Array]:
        """Mean and log-std, each ``[N, act]``, before the sample is bounded, for ``[N, obs]``."""
        missing = self.inputs - observations.shape[1]
        columns = np.pad(observations.astype(np.float64), ((0, 0), (0, missing)))
        hidden = np.clip((columns - self.shift) / self.scale, -self.clip, self.clip)
        for weight, bias in zip(self.weights[:-1], self.biases[:-1], strict=True):
            hidden = hidden @ weight.T + bias
            hidden = np.tanh(hidden) if self.activation == "tanh" else np.maximum(hidden, 0.0)
        log_std = np.clip(hidden @ self.log_std_weight.T + self.log_std_bias, *LOG_STD_BOUNDS)
        return hidden @ self.weights[-1].T + self.biases[-1], log_std

    def _bound(self, action: Array) -> FloatArray:
        return (np.tanh(action) if self.squash else np.clip(action, -1.0, 1.0)).astype(np.float32)

    def mean_action(self, observation: FloatArray) -> FloatArray:
        """The deterministic action ``[act]`` for one observation ``[obs]``."""
        return self._bound(self.gaussian(observation[None])[0][0])

    def act(self, observation: FloatArray, generator: np.random.Generator) -> FloatArray:
        """A sampled action ``[act]`` for one observation ``[obs]``."""
        mean, log_std = self.gaussian(observation[None])
        return self._bound(mean[0] + np.exp(log_std[0]) * generator.standard_normal(self.actions))


def read_teacher(path: Path) -> Teacher:
    """The teacher in an ``.npz`` file of any origin.

    Raises:
        UserError: the file cannot be read, holds Python objects, or is not a policy in the layout above.
    """
    remedy = "A teacher is an .npz of plain arrays; tools/teachers.py describes the layout."
    try:
        content = path.read_bytes()
        arrays = _read_arrays(content)
        return _teacher(arrays, {**_provenance(arrays), "sha256": hashlib.sha256(content).hexdigest()})
    except (OSError, EOFError, ValueError, KeyError, MemoryError, zipfile.BadZipFile, zlib.error) as error:
        cause = f"lacks {error}" if isinstance(error, KeyError) else str(error)
        raise UserError(f"Cannot use teacher '{path.name}': {cause}.", remedy) from error


def _read_arrays(content: bytes) -> dict[str, NDArray[Any]]:
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        if sum(member.file_size for member in archive.infolist()) > MAX_BYTES:
            raise ValueError(f"it unpacks to more than {MAX_BYTES >> 20} MiB")
    with np.load(io.BytesIO(content), allow_pickle=False) as archive:
        return {name: archive[name] for name in archive.files}


def _provenance(arrays: Mapping[str, NDArray[Any]]) -> dict[str, str]:
    meta = json.loads(str(arrays["meta"]))
    if not isinstance(meta, dict) or not all(isinstance(meta.get(key), str) for key in PROVENANCE):
        raise ValueError(f"its meta must be a JSON object with the strings {', '.join(PROVENANCE)}")
    return {key: meta[key] for key in PROVENANCE}


def _teacher(arrays: Mapping[str, NDArray[Any]], provenance: Mapping[str, str]) -> Teacher:
    def real(name: str, *shape: int) -> Array:
        values = arrays[name]
        if values.dtype.kind not in "fiu" or not np.isfinite(values).all():
            raise ValueError(f"'{name}' must be finite numbers")
        if shape and values.shape != shape:
            raise ValueError(f"'{name}' has shape {values.shape}, expected {shape}")
        return values.astype(np.float64)

    count = sum(name[:1] == "W" and name[1:].isdigit() for name in arrays)
    weights = [real(f"W{index}") for index in range(count)]
    if count < 2 or any(weight.ndim != 2 for weight in weights):
        raise ValueError("it needs at least two layers W0, W1, … of two dimensions")
    for below, (index, weight) in zip(weights, list(enumerate(weights))[1:], strict=False):
        real(f"W{index}", weight.shape[0], below.shape[0])
    biases = [real(f"b{index}", weight.shape[0]) for index, weight in enumerate(weights)]
    actions, last_hidden = weights[-1].shape
    inputs = weights[0].shape[1]

    if "logstd" in arrays:
        head_weight, head_bias = np.zeros((actions, last_hidden)), real("logstd", actions)
    else:
        head_weight, head_bias = real("logstd_W", actions, last_hidden), real("logstd_b", actions)

    shift, scale, clip = np.zeros(inputs), np.ones(inputs), np.inf
    if "obs_mean" in arrays:
        shift, clip = real("obs_mean", inputs), float(real("obs_clip"))
        scale = np.sqrt(real("obs_var", inputs) + real("obs_eps"))
    elif "in_shift" in arrays:
        shift, scale = real("in_shift", inputs), real("in_scale", inputs) + DAPG_SCALE_EPSILON
        out_scale = real("out_scale", actions)
        weights[-1] = weights[-1] * out_scale[:, None]
        biases[-1] = biases[-1] * out_scale + real("out_shift", actions)
    if not (scale > 0).all():
        raise ValueError("its observation scale must be positive")

    activation = str(arrays["hidden"])
    if activation not in ACTIVATIONS:
        raise ValueError(f"'hidden' must be {' or '.join(ACTIVATIONS)}")
    squash = bool(arrays["squash"])
    return Teacher(
        tuple(weights),
        tuple(biases),
        head_weight,
        head_bias,
        shift,
        scale,
        clip,
        activation,
        squash,
        provenance,
    )
