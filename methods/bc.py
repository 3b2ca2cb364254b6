"""BC on the full offline data, as SMODICE's authors run it.

What ships as "BC" is an entropy-constrained likelihood (``released``); ``paper`` is the plain likelihood with the
seed paper's batch of 1024. ``--set bc.loss=squared`` clones with DILO's deterministic policy and squared error,
for a like-for-like comparison with DILO and BCO.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import torch
from pydantic import Field

from lfobench.contract.method import (
    Batch,
    DataNeeds,
    Method,
    MethodConfig,
    Metrics,
    Shapes,
    Sizes,
    Stage,
    Widths,
)
from lfobench.nn.policies import DeterministicPolicy, TanhGaussianPolicy
from lfobench.randomness import StepRandomness

if TYPE_CHECKING:
    from torch import Tensor

# 12k steps of batch 256, what a CPU has time for, with rates raised as DILO's are. No claim that they suffice.
QUICK = {"batch_size": 256, "learning_rate": 1e-3}


class BcConfig(MethodConfig):
    """Hyperparameters of behavioural cloning."""

    batch_size: int = Field(512, ge=1, description="Rows per seed and step.")
    hidden: Widths = Field((256, 256), description="Hidden widths of the policy.")
    loss: Literal["entropy-constrained", "likelihood", "squared"] = Field(
        "entropy-constrained", description="Likelihood with or without the entropy term, or squared error."
    )
    learning_rate: float = Field(3e-4, gt=0, description="Adam step size.")
    standardize: bool = Field(True, description="Shift and scale observations by the data's mean and std.")


class Bc(Method):
    """Behavioural cloning of the whole offline mix."""

    name = "bc"
    access_to_expert_actions = True
    Config = BcConfig
    config: BcConfig
    stated = ("loss",)
    presets: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "released": {},
        "paper": {"loss": "likelihood", "batch_size": 1024},
    }
    budgets: ClassVar[Mapping[str, Mapping[str, Any]]] = {
        "quick": QUICK,
        "demo": {**QUICK, "batch_size": 128, "hidden": (128, 128)},
        "smoke": {"batch_size": 32, "hidden": (32, 32)},
    }

    @classmethod
    def needs(cls, config: BcConfig) -> DataNeeds:
        """Offline state-action rows; no expert batch."""
        return DataNeeds(offline=("observation", "action"), standardize=config.standardize)

    def __init__(self, config: BcConfig, shapes: Shapes, seeds: Sequence[int], device: torch.device) -> None:
        self.policy: DeterministicPolicy | TanhGaussianPolicy
        if config.loss == "squared":
            self.policy = DeterministicPolicy(shapes, config.hidden, seeds, device, learning_rate=config.learning_rate)
        else:
            self.policy = TanhGaussianPolicy(
                shapes,
                config.hidden,
                seeds,
                device,
                learning_rate=config.learning_rate,
                entropy_constraint=config.loss == "entropy-constrained",
            )

    def stages(self, sizes: Sizes) -> Sequence[Stage]:
        """One stage on offline rows."""
        return (Stage("policy", None, offline_batch=self.config.batch_size, expert_batch=0),)

    def update(self, stage: str, offline: Batch, expert: Batch, randomness: StepRandomness) -> Metrics:
        """One cloning step on the offline rows."""
        return self.clone(offline, randomness)

    def clone(self, batch: Batch, randomness: StepRandomness) -> Metrics:
        """One step of the policy on the rows of `batch`."""
        if isinstance(self.policy, DeterministicPolicy):
            return {"policy_loss": self.policy.regress(batch["observation"], batch["action"])}
        return self.policy.regress(batch["observation"], batch["action"], None, randomness)

    def act(self, observation: Tensor) -> Tensor:
        """Mean actions."""
        with torch.no_grad():
            return self.policy.act(observation)
