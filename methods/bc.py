"""BC: behavioural cloning of the full offline data O, as SMODICE's authors run it.

    entropy-constrained:  L_pi = -E_O[log pi(a|s)] + exp(l) E_O[log pi(a~|s)],  a~ sampled from pi(.|s)
    likelihood:           L_pi = -E_O[log pi(a|s)]
    squared:              L_pi = E_O[||a - pi(s)||^2]

The first is ``released``: what is published as BC holds the entropy near -dim(a) by a trained log-temperature l, as
Soft Actor-Critic does. The second is ``paper``, with the batch of 1024 that DILO's paper states for every method. Both
have a squashed Gaussian policy (`TanhGaussianPolicy`). The third, ``--set bc.loss=squared``, clones with DILO's
deterministic policy, for a like-for-like comparison with DILO and BCO.
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
    Widths,
)
from lfobench.nn.policies import DeterministicPolicy, TanhGaussianPolicy
from lfobench.randomness import StepRandomness
from methods import DEMO, SMOKE

if TYPE_CHECKING:
    from torch import Tensor

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
        "demo": {**QUICK, **DEMO},
        "smoke": SMOKE,
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

    def update(self, stage: str, offline: Batch, expert: Batch, randomness: StepRandomness) -> Metrics:
        """One cloning step on the offline rows."""
        return self.clone(offline, randomness)

    def clone(self, batch: Batch, randomness: StepRandomness) -> Metrics:
        """One step of the policy on the rows of `batch`."""
        if isinstance(self.policy, DeterministicPolicy):
            return self.policy.regress(batch["observation"], batch["action"])
        return self.policy.regress(batch["observation"], batch["action"], randomness)

    def act(self, observation: Tensor) -> Tensor:
        """``pi(s)``, or ``tanh`` of its mean."""
        return self.policy.act(observation)
