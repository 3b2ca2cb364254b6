"""BC on the one expert trajectory with its actions: the reference that imitation from observation lacks.

No code is public; the learner is `bc`'s on the demonstration's rows only. Observations are
standardised with the offline data's statistics, as for `bc`.
"""

from __future__ import annotations

from collections.abc import Sequence

from lfobench.contract.method import Batch, DataNeeds, Metrics, Sizes, Stage
from lfobench.randomness import StepRandomness
from methods.bc import Bc, BcConfig


class BcExpert(Bc):
    """Behavioural cloning of the demonstration with its actions."""

    name = "bc-expert"

    @classmethod
    def needs(cls, config: BcConfig) -> DataNeeds:
        """Expert state-action rows; no offline batch."""
        return DataNeeds(offline=(), expert=("observation", "action"), standardize=config.standardize)

    def stages(self, sizes: Sizes) -> Sequence[Stage]:
        """One stage on expert rows."""
        return (Stage("policy", None, offline_batch=0, expert_batch=self.config.batch_size),)

    def update(self, stage: str, offline: Batch, expert: Batch, randomness: StepRandomness) -> Metrics:
        """One cloning step on the expert rows."""
        return self.clone(expert, randomness)
