"""Distillation: an MLP in PyTorch fitted to a teacher's Gaussians by DAgger, and the card of its weights."""

from __future__ import annotations

import dataclasses
import hashlib
import itertools
import math
import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

import numpy as np
import safetensors.numpy
import torch
from torch import Tensor, nn

from lfobench.contract.suite import Environment, FloatArray, Level
from lfobench.errors import UserError
from suites.demonstrators.policy import GaussianTanhPolicy
from tools.locomotion_measure import Act, measure, play, without_noise
from tools.teachers import Teacher


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

        The KL divergence of the unbounded Gaussians is that of the squashed ones; the second term adds weight to
        errors of the mean that are small compared with the std.
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


# Ant without contact forces has 27 columns; teachers of the 111-column Ant saw zeros in the others.
PADDED_INPUTS = {27: 111}


@dataclass(frozen=True)
class Settings:
    """Settings of a distillation; every field is on the card.

    Attributes:
        seed: decides the weights together with the library versions.
        exploration: factor on the teacher's std.
        rounds: of rolling out, labelling and fitting; the teacher acts in the first one only.
        transitions: states labelled per round.
        round_steps: gradient steps after each round.
        final_steps: gradient steps after the last one.
        batch: rows per gradient step.
        rate: first learning rate of each fit.
        hidden: widths of the student's hidden layers.
    """

    seed: int = 0
    exploration: float = 1.0
    rounds: int = 8
    transitions: int = 20_000
    round_steps: int = 3_000
    final_steps: int = 30_000
    batch: int = 1024
    rate: float = 1e-3
    hidden: tuple[int, ...] = (128, 128)


def distil(environment: Environment, teacher: Teacher, settings: Settings, report: Callable[[str], None]) -> bytes:
    """The ``.safetensors`` bytes of a student of `teacher`; the same settings give the same bytes.

    Args:
        environment: where both act.
        teacher: labels every visited state.
        settings: of the distillation.
        report: gets one line per round.
    """
    _check_fit(environment, teacher)
    # More threads sum in another order, and the same seed would give other weights.
    torch.set_num_threads(1)
    torch.manual_seed(settings.seed)
    generator = np.random.default_rng(settings.seed)
    teacher = teacher.calmed(settings.exploration)

    visited, levels = _roll_out(environment, [teacher.act], settings.transitions, generator)
    report(f"round 1 of {settings.rounds}: teacher's return {np.mean(levels):.0f}")
    student = Student(visited, teacher.actions, settings.hidden, teacher.squash)
    rows = [visited]
    for number in range(2, settings.rounds + 1):
        _fit(student, teacher, rows, settings, settings.round_steps)
        policy = GaussianTanhPolicy(student.content())
        # Data is made from sampled actions; the mean action's states are labelled too, since it is measured.
        actors = [policy.act, without_noise(policy.mean_action)]
        visited, levels = _roll_out(environment, actors, settings.transitions, generator)
        report(f"round {number} of {settings.rounds}: student's return {np.mean(levels):.0f}")
        rows.append(visited)
    loss = _fit(student, teacher, rows, settings, settings.final_steps)
    report(f"final loss {loss:.4f}")
    return student.content()


def _check_fit(environment: Environment, teacher: Teacher) -> None:
    simulator = environment.make()
    observations, actions = (
        space.shape[0] for space in (simulator.observation_space, simulator.action_space) if space.shape
    )
    simulator.close()
    if teacher.inputs not in (observations, PADDED_INPUTS.get(observations)) or teacher.actions != actions:
        raise UserError(
            f"The teacher reads {teacher.inputs} columns and gives {teacher.actions}; {environment.id} has "
            f"{observations} and takes {actions}.",
            "Give a teacher of this environment.",
        )


def _roll_out(
    environment: Environment, actors: Sequence[Act], transitions: int, generator: np.random.Generator
) -> tuple[FloatArray, list[float]]:
    """States ``[transitions, obs]`` of episodes in which the actors take turns, and the episodes' returns."""
    states: list[FloatArray] = []
    returns: list[float] = []
    while len(states) < transitions:
        act = actors[len(returns) % len(actors)]
        steps = list(play(environment, act, int(generator.integers(2**31))))
        states += [step.observation for step in steps]
        returns.append(sum(step.reward for step in steps))
    return np.stack(states[:transitions]), returns


def _fit(student: Student, teacher: Teacher, rows: Sequence[FloatArray], settings: Settings, steps: int) -> float:
    observations = np.concatenate(rows)
    labels = teacher.gaussian(observations)
    columns = [torch.from_numpy(column.astype(np.float32)) for column in (observations, *labels)]
    return student.fit(columns, steps, settings.batch, settings.rate)


EXPERT_BAR = 90.0
# D4RL's reference return for ant is far below what a good policy reaches.
EXPERT_BARS = {"ant": 110.0}
MEDIUM_TOLERANCE = 10.0
LIBRARIES = ("numpy", "torch", "gymnasium", "mujoco")


def make_card(
    environment: Environment,
    level: Level,
    weights: bytes,
    command: str,
    method: str,
    settings: Mapping[str, Any],
    origin: Mapping[str, Any],
    libraries: Sequence[str] = LIBRARIES,
    episodes: int = 100,
) -> dict[str, Any]:
    """The card of weights, which are measured here: origin, settings, levels, versions.

    Args:
        environment: where the level is measured.
        level: intended.
        weights: the weight file's bytes.
        command: that makes them again.
        method: of fitting, in a line.
        settings: of the method, all of them.
        origin: fields of the card on the teacher or the demonstrations.
        libraries: whose versions decide weights and level.
        episodes: per measurement.
    """
    return {
        "environment": dataclasses.asdict(environment),
        "level": level,
        "sha256": hashlib.sha256(weights).hexdigest(),
        "licence": "MIT",
        "made_with": command,
        "method": method,
        "settings": dict(settings),
        **origin,
        "levels": _levels(environment, GaussianTanhPolicy(weights), episodes),
        "versions": {"python": platform.python_version(), **{library: version(library) for library in libraries}},
    }


def make_student_card(
    environment: Environment,
    level: Level,
    weights: bytes,
    teacher: Teacher,
    settings: Settings,
    command: str,
    libraries: Sequence[str] = LIBRARIES,
    episodes: int = 100,
) -> dict[str, Any]:
    """The card of weights that were distilled from a teacher, which is measured too; see `make_card`."""
    method = "DAgger (arXiv:1011.0686) from the teacher's mean and std to a Gaussian tanh MLP"
    origin = {"teacher": {**teacher.provenance, "levels": _levels(environment, teacher, episodes)}}
    fields = dataclasses.asdict(settings)
    return make_card(environment, level, weights, command, method, fields, origin, libraries, episodes)


def _levels(
    environment: Environment, policy: Teacher | GaussianTanhPolicy, episodes: int
) -> dict[str, dict[str, float]]:
    actors = {"sampled": policy.act, "deterministic": without_noise(policy.mean_action)}
    return {name: dataclasses.asdict(measure(environment, act, episodes)) for name, act in actors.items()}


def shortfall(card: Mapping[str, Any]) -> str:
    """The reason why carded weights miss their level, or nothing.

    An expert reaches the bar with actions sampled and without; a medium policy's sampled score is within
    ``MEDIUM_TOLERANCE`` of its teacher's.
    """
    scores = {name: level["score_mean"] for name, level in card["levels"].items()}
    if card["level"] == "expert":
        bar = EXPERT_BARS.get(card["environment"]["name"], EXPERT_BAR)
        below = [f"{score:.1f} {name}" for name, score in scores.items() if score < bar]
        return f"an expert scores at least {bar:.0f}, this one {' and '.join(below)}" if below else ""
    goal = card["teacher"]["levels"]["sampled"]["score_mean"]
    if abs(scores["sampled"] - goal) > MEDIUM_TOLERANCE:
        return f"its teacher scores {goal:.1f}, this one {scores['sampled']:.1f}"
    return ""
