"""Methods as people write them: right ones with ordinary modules, and one for every rule that can be broken."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from pydantic import Field
from torch import Tensor, nn

from lfobench.contract.method import Batch, DataNeeds, Method, MethodConfig, Metrics, Shapes, State
from lfobench.nn.modules import PerSeed
from lfobench.randomness import StepRandomness


class NaiveConfig(MethodConfig):
    """Hyperparameters of the naive method."""

    batch_size: int = Field(16, description="Rows.")
    rate: float = Field(1e-2, description="Adam step size.")


class Naive(Method):
    """A module and an optimiser per seed, in lists, as anybody would write it first."""

    name = "naive"
    Config = NaiveConfig

    @classmethod
    def needs(cls, config: NaiveConfig) -> DataNeeds:
        return DataNeeds(offline=("observation", "action"))

    def __init__(self, config: NaiveConfig, shapes: Shapes, seeds: Sequence[int], device: torch.device) -> None:
        self.networks = []
        for seed in seeds:
            torch.manual_seed(seed)
            layers = (nn.Linear(shapes.observation, 16), nn.ReLU(), nn.Linear(16, shapes.action), nn.Tanh())
            self.networks.append(nn.Sequential(*layers).to(device))
        self.optimizers = [torch.optim.Adam(network.parameters(), lr=config.rate) for network in self.networks]

    def update(self, stage: str, offline: Batch, expert: Batch, randomness: StepRandomness) -> Metrics:
        losses = []
        for index, (network, optimizer) in enumerate(zip(self.networks, self.optimizers, strict=True)):
            loss = (network(offline["observation"][index]) - offline["action"][index]).square().mean()
            optimizer.zero_grad()
            loss.backward()
            optimizer.step()
            losses.append(loss.detach())
        return {"loss": torch.stack(losses)}

    def act(self, observation: Tensor) -> Tensor:
        return torch.stack([network(rows) for network, rows in zip(self.networks, observation, strict=True)])


class Adapted(Naive):
    """The same with `PerSeed`, one optimiser for all seeds and a schedule of its rate."""

    name = "adapted"

    def __init__(self, config: NaiveConfig, shapes: Shapes, seeds: Sequence[int], device: torch.device) -> None:
        sizes = (shapes.observation, 16, shapes.action)
        self.policy = PerSeed(
            lambda: nn.Sequential(nn.Linear(*sizes[:2]), nn.ReLU(), nn.Linear(*sizes[1:])), seeds, device
        )
        self.optimizer = torch.optim.AdamW(self.policy.parameters(), lr=config.rate)
        self.schedule = torch.optim.lr_scheduler.CosineAnnealingLR(self.optimizer, T_max=100)
        self.updates = 0

    def update(self, stage: str, offline: Batch, expert: Batch, randomness: StepRandomness) -> Metrics:
        error = self.act(offline["observation"]) - offline["action"]
        loss = error.square().mean((1, 2)) + 0.0 * randomness.normal("noise")
        self.optimizer.zero_grad()
        loss.sum().backward()
        self.optimizer.step()
        self.schedule.step()
        self.updates += 1
        return {"loss": loss.detach()}

    def act(self, observation: Tensor) -> Tensor:
        return torch.tanh(self.policy(observation))


class Momentum(Naive):
    """Stacked parameters of its own, and a torch optimiser with a buffer."""

    name = "momentum"

    def __init__(self, config: NaiveConfig, shapes: Shapes, seeds: Sequence[int], device: torch.device) -> None:
        self.weight = nn.Parameter(torch.zeros(len(seeds), shapes.observation, shapes.action, device=device))
        self.optimizer = torch.optim.SGD([self.weight], lr=config.rate, momentum=0.9)
        self.limits = {"low": torch.full((3,), -1.0), "high": 1.0}

    def update(self, stage: str, offline: Batch, expert: Batch, randomness: StepRandomness) -> Metrics:
        loss = (self.act(offline["observation"]) - offline["action"]).square().mean((1, 2))
        self.optimizer.zero_grad()
        loss.sum().backward()
        self.optimizer.step()
        return {"loss": loss.detach()}

    def act(self, observation: Tensor) -> Tensor:
        return torch.tanh(observation @ self.weight)


class Delayed(Momentum):
    """A target in a deque that is refreshed now and then, by a NumPy count, and noise of a generator that torch has."""

    name = "delayed"

    def __init__(self, config: NaiveConfig, shapes: Shapes, seeds: Sequence[int], device: torch.device) -> None:
        super().__init__(config, shapes, seeds, device)
        self.targets = deque([torch.zeros_like(self.weight.detach())], maxlen=1)
        self.count = np.int64(0)
        self.generators = [torch.Generator().manual_seed(seed) for seed in seeds]
        self.mask = torch.full((len(seeds), 2), -torch.inf)

    def update(self, stage: str, offline: Batch, expert: Batch, randomness: StepRandomness) -> Metrics:
        noise = torch.stack([torch.randn(offline["action"].shape[1:], generator=each) for each in self.generators])
        metrics = super().update(stage, {**offline, "action": offline["action"] + noise}, expert, randomness)
        self.count += 1
        if self.count % 7 == 0:
            self.targets[0].copy_(self.weight.detach())
        return metrics

    def act(self, observation: Tensor) -> Tensor:
        return torch.tanh(observation @ (self.weight + self.targets[0]))


SOUND: tuple[type[Method], ...] = (Naive, Adapted, Momentum, Delayed)


class Copies(Naive):
    """`state` returns copies, so nothing that is restored arrives."""

    def state(self) -> State:
        layers = [network[0] for network in self.networks]
        return {"weight": torch.stack([layer.weight.detach() for layer in layers])}


class Partial(Momentum):
    """`state` forgets the optimiser's buffer's like: a running mean."""

    def __init__(self, config: NaiveConfig, shapes: Shapes, seeds: Sequence[int], device: torch.device) -> None:
        super().__init__(config, shapes, seeds, device)
        self.mean = torch.zeros(len(seeds), device=device)

    def update(self, stage: str, offline: Batch, expert: Batch, randomness: StepRandomness) -> Metrics:
        self.mean += offline["action"].mean((1, 2))
        return {"mean": self.mean.clone()}

    def state(self) -> State:
        return {"weight": self.weight}


class Replacing(Naive):
    """A weight that is made anew at every update: right, and not to be recorded."""

    def __init__(self, config: NaiveConfig, shapes: Shapes, seeds: Sequence[int], device: torch.device) -> None:
        self.weight = torch.zeros(len(seeds), shapes.observation, shapes.action, device=device)

    def update(self, stage: str, offline: Batch, expert: Batch, randomness: StepRandomness) -> Metrics:
        self.weight = self.weight + 0.1 * offline["observation"].mean(1)[..., None]
        return {"weight": self.weight.mean((1, 2))}

    def act(self, observation: Tensor) -> Tensor:
        return torch.tanh(observation @ self.weight)


class Mixed(Momentum):
    """The norm of all seeds' gradients limits each."""

    def update(self, stage: str, offline: Batch, expert: Batch, randomness: StepRandomness) -> Metrics:
        loss = (self.act(offline["observation"]) - offline["action"]).square().mean((1, 2))
        self.optimizer.zero_grad()
        (100.0 * loss.sum()).backward()
        nn.utils.clip_grad_norm_([self.weight], 0.1)
        self.optimizer.step()
        return {"loss": loss.detach()}


class Shared(Momentum):
    """One network for all seeds."""

    def __init__(self, config: NaiveConfig, shapes: Shapes, seeds: Sequence[int], device: torch.device) -> None:
        self.weight = nn.Parameter(torch.zeros(1, shapes.observation, shapes.action, device=device))
        self.optimizer = torch.optim.SGD([self.weight], lr=config.rate)


class Chancy(Momentum):
    """Noise from torch's own generator."""

    def update(self, stage: str, offline: Batch, expert: Batch, randomness: StepRandomness) -> Metrics:
        offline = {**offline, "action": offline["action"] + 0.1 * torch.randn_like(offline["action"])}
        return super().update(stage, offline, expert, randomness)


class Unseeded(Adapted):
    """Initial weights from torch's own generator."""

    def __init__(self, config: NaiveConfig, shapes: Shapes, seeds: Sequence[int], device: torch.device) -> None:
        super().__init__(config, shapes, seeds, device)
        for module in self.policy:
            nn.init.normal_(module[0].weight)  # type: ignore[index, arg-type]


class Loud(Momentum):
    """Actions beyond the box."""

    def act(self, observation: Tensor) -> Tensor:
        return 3.0 * torch.tanh(observation @ self.weight + 1.0)


class Flat(Momentum):
    """Actions without the seed axis."""

    def act(self, observation: Tensor) -> Tensor:
        action = super().act(observation)
        return action if torch.is_grad_enabled() else action.flatten(0, 1)


class Counting(Momentum):
    """Acting counts."""

    def __init__(self, config: NaiveConfig, shapes: Shapes, seeds: Sequence[int], device: torch.device) -> None:
        super().__init__(config, shapes, seeds, device)
        self.acted = 0

    def act(self, observation: Tensor) -> Tensor:
        self.acted += 1
        return super().act(observation)


class Late(Momentum):
    """A running mean that begins to exist in the first update."""

    def update(self, stage: str, offline: Batch, expert: Batch, randomness: StepRandomness) -> Metrics:
        self.mean = offline["observation"].mean((1, 2))
        return super().update(stage, offline, expert, randomness)


class Scalar(Momentum):
    """One metric for all seeds."""

    def update(self, stage: str, offline: Batch, expert: Batch, randomness: StepRandomness) -> Metrics:
        return {"loss": super().update(stage, offline, expert, randomness)["loss"].mean()}


class Attached(Momentum):
    """Metrics that hold the graph."""

    def update(self, stage: str, offline: Batch, expert: Batch, randomness: StepRandomness) -> Metrics:
        super().update(stage, offline, expert, randomness)
        return {"loss": self.act(offline["observation"]).mean((1, 2))}


class Odd(Momentum):
    """A tensor with a row more than there are seeds."""

    def __init__(self, config: NaiveConfig, shapes: Shapes, seeds: Sequence[int], device: torch.device) -> None:
        super().__init__(config, shapes, seeds, device)
        self.odd = torch.zeros(len(seeds) + 1)


class Hidden(Momentum):
    """A generator of NumPy's, which cannot be saved."""

    def __init__(self, config: NaiveConfig, shapes: Shapes, seeds: Sequence[int], device: torch.device) -> None:
        super().__init__(config, shapes, seeds, device)
        self.generator = np.random.default_rng(0)

    def update(self, stage: str, offline: Batch, expert: Batch, randomness: StepRandomness) -> Metrics:
        noise = torch.from_numpy(self.generator.standard_normal(offline["action"].shape[1:], dtype=np.float32))
        return super().update(stage, {**offline, "action": offline["action"] + noise}, expert, randomness)


class Greedy(Naive):
    """Asks for expert actions without access."""

    @classmethod
    def needs(cls, config: Any) -> DataNeeds:
        return DataNeeds(offline=("observation", "action"), expert=("observation", "action"))


class Reading(Momentum):
    """Prints its loss."""

    def update(self, stage: str, offline: Batch, expert: Batch, randomness: StepRandomness) -> Metrics:
        found = super().update(stage, offline, expert, randomness)
        if found["loss"].sum().item() < 0.0:
            raise RuntimeError("a squared error below zero")
        return found


class Raising(Momentum):
    """An ordinary bug."""

    def update(self, stage: str, offline: Batch, expert: Batch, randomness: StepRandomness) -> Metrics:
        return {"loss": offline["reward"]}  # type: ignore[index]


BROKEN: tuple[tuple[type[Method], str, str], ...] = (
    (Copies, "saved and restored", "weight"),
    (Mixed, "seed alone", "weight"),
    (Shared, "seed alone", "weight"),
    (Chancy, "chance", "weight"),
    (Unseeded, "chance", "policy"),
    (Loud, r"\[-1, 1\]", "component of"),
    (Flat, "shape", "act"),
    (Counting, "acting changes nothing", "acted"),
    (Late, "acting changes nothing", "mean"),
    (Scalar, "metrics", "shape"),
    (Attached, "metrics", "detached"),
    (Odd, "state", "odd"),
    (Hidden, "state", "generator"),
    (Partial, "saved and restored", "mean"),
    (Greedy, "may see", "expert actions"),
    (Raising, "metrics", "reward"),
)
"""Class, part of the rule that it breaks, and a word of what is said."""
