"""The student in PyTorch: the MLP of ``policy.GaussianTanhPolicy``, fitted to a teacher's Gaussians."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

import numpy as np
import safetensors.numpy
import torch
from torch import Tensor, nn

from lfobench.contract.suite import FloatArray


class Student(nn.Module):
    """Tanh MLP from a standardised observation to the mean and log-std of a Gaussian.

    Args:
        observations: ``[N, obs]``, whose moments standardise the input.
        actions: number of action columns.
        hidden: widths of the hidden layers.
        squash: whether tanh bounds the sample; otherwise it is clipped.
    """

    def __init__(self, observations: FloatArray, actions: int, hidden: Sequence[int], squash: bool) -> None:
        super().__init__()
        self.shift: Tensor
        self.scale: Tensor
        self.register_buffer("shift", torch.from_numpy(observations.mean(0)))
        self.register_buffer("scale", torch.from_numpy(observations.std(0) + 1e-3))
        widths = [observations.shape[1], *hidden]
        self.hidden = nn.ModuleList(nn.Linear(*pair) for pair in itertools.pairwise(widths))
        self.head = nn.Linear(widths[-1], 2 * actions)
        self.squash = squash

    def forward(self, observations: Tensor) -> tuple[Tensor, Tensor]:
        """Mean and log-std, each ``[N, act]``, before the sample is bounded, for ``[N, obs]``."""
        features = (observations - self.shift) / self.scale
        for layer in self.hidden:
            features = torch.tanh(layer(features))
        mean, log_std = self.head(features).chunk(2, dim=1)
        return mean, log_std

    def loss(self, observations: Tensor, mean: Tensor, log_std: Tensor) -> Tensor:
        """KL(teacher || student) plus the squared error of the mean action, per row, averaged.

        The KL divergence of the unbounded Gaussians is that of the squashed ones; the second term weighs what
        the first forgives, an error of the mean that is small beside a large std.
        """
        student_mean, student_log_std = self(observations)
        variance = torch.exp(2.0 * log_std)
        precision = torch.exp(-2.0 * student_log_std)
        difference = mean - student_mean
        divergence = student_log_std - log_std + 0.5 * ((variance + difference**2) * precision - 1.0)
        if self.squash:
            mean, student_mean = torch.tanh(mean), torch.tanh(student_mean)
        squared = (mean - student_mean) ** 2
        per_row: Tensor = (divergence + squared).sum(dim=1)
        return per_row.mean()

    def content(self) -> bytes:
        """The ``.safetensors`` file's bytes that ``policy.GaussianTanhPolicy`` reads."""
        layers = [*self.hidden, self.head]
        weights = [layer.weight.detach().double() for layer in layers]
        biases = [layer.bias.detach().double() for layer in layers]
        weights[0] = weights[0] / self.scale
        biases[0] = biases[0] - weights[0] @ self.shift.double()
        tensors = {"squash": np.array(self.squash, dtype=np.uint8)}
        for index, (weight, bias) in enumerate(zip(weights, biases, strict=True)):
            tensors[f"weight_{index}"] = weight.float().numpy()
            tensors[f"bias_{index}"] = bias.float().numpy()
        return safetensors.numpy.save(tensors)

    def fit(self, columns: Sequence[Tensor], steps: int, batch: int, rate: float) -> float:
        """Adam with a cosine decay of the learning rate to zero; the mean loss of the last tenth is returned.

        Args:
            columns: observations ``[N, obs]``, and the teacher's mean and log-std ``[N, act]``.
            steps: gradient steps.
            batch: rows per step, drawn with replacement.
            rate: first learning rate.
        """
        optimiser = torch.optim.Adam(self.parameters(), lr=rate)
        losses = []
        for step in range(steps):
            for group in optimiser.param_groups:
                group["lr"] = rate * 0.5 * (1.0 + math.cos(math.pi * step / steps))
            chosen = torch.randint(len(columns[0]), (batch,))
            loss = self.loss(*(column[chosen] for column in columns))
            optimiser.zero_grad()
            loss.backward()
            optimiser.step()
            losses.append(loss.item())
        return float(np.mean(losses[-max(1, steps // 10) :]))
