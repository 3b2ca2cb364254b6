"""Synthetic batches, and a method's tensors as one seed's NumPy arrays."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from references import Array, Parameters, unflatten
from torch import Tensor

from lfobench.contract.method import Batch, DataNeeds, Field, Method, Shapes, Stage
from lfobench.data.firewall import Table, View
from lfobench.data.mixing import ObservationTransform
from lfobench.engine.program import Program
from lfobench.engine.state import live_tensors
from lfobench.randomness import Randomness

CPU = torch.device("cpu")
NO_BATCH: Batch = {}


class GivenRandomness:
    """Draws chosen by the test instead of drawn."""

    def __init__(self, phase: int = 0, *, normal: Tensor | None = None, uniform: Tensor | None = None) -> None:
        self.phase = phase
        self._given = {"normal": normal, "uniform": uniform}

    def normal(self, purpose: str, *shape: int) -> Tensor:
        return self._take("normal", shape)

    def uniform(self, purpose: str, *shape: int) -> Tensor:
        return self._take("uniform", shape)

    def _take(self, kind: str, shape: tuple[int, ...]) -> Tensor:
        given = self._given[kind]
        assert given is not None, f"this update was not expected to draw {kind} numbers"
        assert given.shape[1:] == shape
        return given


def normal(generator: np.random.Generator, *shape: int) -> Tensor:
    """float32 N(0, 1); NumPy's, because torch draws other normal numbers on other processors."""
    return torch.from_numpy(generator.standard_normal(shape, dtype=np.float32))


def uniform(generator: np.random.Generator, *shape: int) -> Tensor:
    """float32 U[0, 1)."""
    return torch.from_numpy(generator.random(shape, dtype=np.float32))


def make_batch(
    fields: Sequence[Field], shapes: Shapes, seeds: int, rows: int, generator: np.random.Generator, ended: float = 0.3
) -> Batch:
    """Observations N(0, 1), actions U(-1, 1), a share `ended` of terminal rows."""
    batch: Batch = {}
    for field in fields:
        if field == "action":
            column = uniform(generator, seeds, rows, shapes.action) * 2.0 - 1.0
        elif field == "label":
            column = uniform(generator, seeds, rows)
        elif field == "terminated":
            column = (uniform(generator, seeds, rows) < ended).float()
        else:
            column = normal(generator, seeds, rows, shapes.observation)
        batch = {**batch, field: column}
    return batch


def rows_of(batch: Batch, seed: int) -> dict[str, Array]:
    """One seed's rows in float64."""
    return {field: column[seed].double().numpy() for field, column in batch.items()}


def flat_of(method: Method, name: str) -> Tensor:
    """The live parameters ``[S*H, P]`` of a network: an attribute of the method, or of what that attribute holds."""
    live = live_tensors(method)
    return live[name if name in live else f"{name}.network"]


def parameters_of(method: Method, name: str, sizes: Sequence[int], row: int) -> Parameters:
    """A network's layers; `row` counts seeds, and heads inside a seed."""
    return unflatten(flat_of(method, name)[row].detach().double().numpy(), sizes)


def first_gradient(method: Method, prefix: str, sizes: Sequence[int], row: int) -> Parameters:
    """The gradient of an optimiser's first step: Adam's first moment is then a tenth of it."""
    assert float(live_tensors(method)[f"{prefix}.step"]) == 1.0
    return unflatten(live_tensors(method)[f"{prefix}.exp_avg"][row].detach().double().numpy() * 10.0, sizes)


def randomize(method: Method, name: str, sizes: Sequence[int], gain: float) -> None:
    """Replace a network's parameters by draws of the test's own, whatever the initialisation.

    A gain of 1 keeps the size of ReLU activations from layer to layer; a larger one reaches the branches of a loss.
    """
    generator = np.random.default_rng(zlib.crc32(name.encode()))
    flat, offset = flat_of(method, name), 0
    for fan_in, fan_out in pairwise(sizes):
        for count, scale in ((fan_in * fan_out, gain * (2.0 / fan_in) ** 0.5), (fan_out, 0.1)):
            flat[:, offset : offset + count] = scale * normal(generator, len(flat), count)
            offset += count


def set_output(method: Method, name: str, sizes: Sequence[int], value: float) -> None:
    """Make a network constant: every parameter 0 but the output bias."""
    flat = flat_of(method, name)
    flat.zero_()
    used = sum(fan_in * fan_out + fan_out for fan_in, fan_out in pairwise(sizes))
    flat[:, used - sizes[-1] : used] = value


def assert_gradients_agree(measured: Parameters, expected: Parameters, tolerance: float = 2e-5) -> None:
    """Every element within `tolerance` of the largest element of its layer array.

    float32 carries 24 bits; a sum over some tens of rows with cancellation leaves about five decimal digits. A
    layer whose gradient vanishes is measured by a tenth of the largest element of all.
    """
    largest = max(float(np.abs(wanted).max()) for wanted in expected)
    for found, wanted in zip(measured, expected, strict=True):
        scale = max(float(np.abs(wanted).max()), 0.1 * largest)
        np.testing.assert_allclose(found, wanted, rtol=0.0, atol=tolerance * scale)


def seed_slices(method: Method, seeds: int, index: int) -> dict[str, Tensor]:
    """One seed's part of every state tensor; scalars (step counters) are shared."""
    return {
        name: (tensor if tensor.dim() == 0 else tensor.reshape(seeds, -1)[index]).detach().clone()
        for name, tensor in live_tensors(method).items()
    }


def random_view(needs: DataNeeds, shapes: Shapes, offline_rows: int, expert_rows: int) -> View:
    """Random data behind the engine's own tables."""
    generator = np.random.default_rng(7)

    def table(fields: Sequence[Field], rows: int) -> Table:
        batch = make_batch(fields, shapes, 1, rows, generator)
        return Table({field: (column[0], torch.arange(rows)) for field, column in batch.items()}, rows, rows)

    offline: list[Field] = [field for field in needs.offline if field != "initial_observation"]
    initial: list[Field] = [field for field in needs.offline if field == "initial_observation"]
    zeros = np.zeros(shapes.observation, np.float32)
    transform = ObservationTransform(zeros, zeros + 1.0, False)
    return View(table(offline, offline_rows), table(initial, 200), table(needs.expert, expert_rows), shapes, transform)


def train(
    method: Method, stage: Stage, view: View, seeds: Sequence[int], steps: int, first_step: int = 0
) -> list[dict[str, Tensor]]:
    """Updates as the engine makes them; returns their metrics."""
    program = Program(method, view, stage, Randomness(seeds))
    metrics = []
    for step in range(first_step, first_step + steps):
        program.update(step)
        metrics.append({name: total.clone() for name, total in program.metric_sums().items()})
        program.clear_metrics()
    return metrics


def build(method: type[Method], shapes: Shapes, seeds: Sequence[int], **overrides: Any) -> Any:
    """A method with its defaults but for `overrides`."""
    return method(method.Config(**overrides), shapes, seeds, CPU)
