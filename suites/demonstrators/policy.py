"""Policies of the generated data, as NumPy functions of one observation at a time."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import safetensors.numpy
from numpy.typing import NDArray

from lfobench.contract.suite import FloatArray

Array = NDArray[np.float64]


class UniformPolicy:
    """Uniform actions in [-1, 1], D4RL's ``random`` level.

    Args:
        actions: number of action columns.
    """

    def __init__(self, actions: int) -> None:
        self.actions = actions

    @property
    def fingerprint(self) -> str:
        """Hash of the rule and the number of columns."""
        return hashlib.sha256(f"uniform in [-1, 1], {self.actions} columns, float32".encode()).hexdigest()

    def act(self, observation: FloatArray, generator: np.random.Generator) -> FloatArray:
        """An action ``[act]`` that does not depend on the observation ``[obs]``."""
        return generator.random(self.actions, dtype=np.float32) * np.float32(2.0) - np.float32(1.0)


class GaussianTanhPolicy:
    """A tanh MLP that gives a Gaussian's mean and log-std; the sample is bounded to [-1, 1].

    The file holds ``weight_i`` ``[out, in]`` and ``bias_i`` ``[out]``, the last layer with ``2 act`` rows
    (means, then log-stds), and ``squash``: 1 where tanh bounds the sample (the Gaussian of SAC and TQC), 0
    where clipping does (that of TRPO and PPO). The observation standardisation is folded into the first layer.

    Computed in float64 and rounded once at the end: processors sum in different orders, which in float32 would
    change the last bit of an action, and with it every later state of the episode.

    Args:
        content: a ``.safetensors`` file's bytes.
    """

    def __init__(self, content: bytes) -> None:
        tensors = {name: tensor.astype(np.float64) for name, tensor in safetensors.numpy.load(content).items()}
        layers = sum(name.startswith("weight_") for name in tensors)
        self._hidden = [(tensors[f"weight_{layer}"], tensors[f"bias_{layer}"]) for layer in range(layers - 1)]
        self._weight, self._bias = tensors[f"weight_{layers - 1}"], tensors[f"bias_{layers - 1}"]
        self._squash = bool(tensors["squash"])
        self._actions = len(self._bias) // 2
        self._fingerprint = hashlib.sha256(content).hexdigest()

    @classmethod
    def read(cls, path: Path) -> GaussianTanhPolicy:
        """The policy in a ``.safetensors`` file."""
        return cls(path.read_bytes())

    @property
    def fingerprint(self) -> str:
        """The weight file's sha256."""
        return self._fingerprint

    def _outputs(self, observation: FloatArray) -> Array:
        hidden = observation.astype(np.float64)
        for weight, bias in self._hidden:
            hidden = np.tanh(weight @ hidden + bias)
        outputs: Array = self._weight @ hidden + self._bias
        return outputs

    def _bound(self, action: Array) -> FloatArray:
        # np.clip costs more than the rest of the forward pass at these sizes.
        bounded = np.tanh(action) if self._squash else np.maximum(np.minimum(action, 1.0), -1.0)
        return bounded.astype(np.float32)

    def mean_action(self, observation: FloatArray) -> FloatArray:
        """The deterministic action ``[act]`` for one observation ``[obs]``."""
        return self._bound(self._outputs(observation)[: self._actions])

    def act(self, observation: FloatArray, generator: np.random.Generator) -> FloatArray:
        """A sampled action ``[act]`` for one observation ``[obs]``."""
        outputs = self._outputs(observation)
        noise = generator.standard_normal(self._actions)
        return self._bound(outputs[: self._actions] + np.exp(outputs[self._actions :]) * noise)
