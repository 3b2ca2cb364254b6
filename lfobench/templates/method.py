"""Mine: cloning of the offline data, for a start. Learning from the expert's observations comes here.

lfobench check mine.py
lfobench run --methods mine.py,bc --suite locomotion --protocol smoke
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from pydantic import Field
from torch import Tensor, nn

from lfobench.contract.method import Batch, DataNeeds, Method, MethodConfig, Metrics, Shapes
from lfobench.nn.modules import PerSeed
from lfobench.randomness import StepRandomness


class MineConfig(MethodConfig):
    """Hyperparameters, for --set mine.learning_rate=0.001."""

    batch_size: int = Field(256, ge=1, description="Rows per seed and step.")
    learning_rate: float = Field(1e-3, gt=0, description="Adam step size.")


class Mine(Method):
    """Cloning of the offline data by squared error."""

    name = "mine"
    Config = MineConfig
    access_to_expert_actions = True  # some rows of the offline data are the expert's; False for what only observes it

    @classmethod
    def needs(cls, config: MineConfig) -> DataNeeds:
        """Offline rows; expert=("observation", "next_observation") adds the demonstration's."""
        return DataNeeds(offline=("observation", "action"), standardize=True)

    def __init__(self, config: MineConfig, shapes: Shapes, seeds: Sequence[int], device: torch.device) -> None:
        def network() -> nn.Module:
            first, last = nn.Linear(shapes.observation, 256), nn.Linear(256, shapes.action)
            return nn.Sequential(first, nn.ReLU(), last, nn.Tanh())

        self.policy = PerSeed(network, seeds, device)
        self.optimizer = torch.optim.Adam(self.policy.parameters(), config.learning_rate)

    def update(self, stage: str, offline: Batch, expert: Batch, randomness: StepRandomness) -> Metrics:
        """One step for every seed; batches are ``[S, B, ...]``, losses ``[S]``."""
        loss = (self.policy(offline["observation"]) - offline["action"]).square().sum(-1).mean(-1)
        self.optimizer.zero_grad()
        loss.sum().backward()
        self.optimizer.step()
        return {"policy_loss": loss.detach()}

    def act(self, observation: Tensor) -> Tensor:
        """Actions in [-1, 1]."""
        actions: Tensor = self.policy(observation)
        return actions
