"""BC on the one expert trajectory with its actions: the reference that imitation from observation lacks.

The losses are those of `methods.bc` over expert data E in place of offline data. No code for it is public. Observations
are standardised with the offline data's statistics, as for `bc`.
"""

from __future__ import annotations

from lfobench.contract.method import Batch, DataNeeds, Metrics
from lfobench.randomness import StepRandomness
from methods.bc import Bc, BcConfig


class BcExpert(Bc):
    """Behavioural cloning of the demonstration with its actions."""

    name = "bc-expert"

    @classmethod
    def needs(cls, config: BcConfig) -> DataNeeds:
        """Expert state-action rows; no offline batch."""
        return DataNeeds(offline=(), expert=("observation", "action"), standardize=config.standardize)

    def update(self, stage: str, offline: Batch, expert: Batch, randomness: StepRandomness) -> Metrics:
        """One cloning step on the expert rows."""
        return self.clone(expert, randomness)
