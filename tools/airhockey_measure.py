"""Success rates and failures of the robot's scripted demonstrators: ``python -m tools.airhockey_measure``."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterator

import numpy as np
from scipy.stats import binomtest

from suites.robot.demonstrators import SINGLE_HITS, demonstrators
from suites.robot.demonstrators.recording import SUCCESS

SHARE_OF_REPEATED = 10
"""A recording of repeated hits takes ten times as long as another, so one in ten is made."""


def lines(episodes: int, seed: int) -> Iterator[str]:
    """Lines of a table: a heading, and one per demonstrator."""
    yield f"{'environment':36}{'level':17}{'episodes':>8}{'success %':>11}{'95 % interval':>16}{'steps':>8}  failures"
    for environment, levels in demonstrators().items():
        for level, maker in levels.items():
            repeated = "repeated" in level
            count = SINGLE_HITS + episodes // SHARE_OF_REPEATED if repeated else episodes
            take = maker.perform(count, np.random.default_rng(seed))
            outcomes = Counter(take.outcomes.tolist())
            successes = outcomes.pop(SUCCESS, 0)
            bounds = binomtest(successes, count).proportion_ci(method="wilson")
            interval = f"{100 * bounds.low:.1f} to {100 * bounds.high:.1f}"
            failures = ", ".join(f"{outcome or 'no end'} {number}" for outcome, number in outcomes.most_common())
            yield (
                f"{environment:36}{level:17}{count:8}{100 * successes / count:11.1f}{interval:>16}"
                f"{take.episodes.lengths.mean():8.1f}  {failures}"
            )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--episodes", type=int, default=1000, help="episodes per demonstrator")
    parser.add_argument("--seed", type=int, default=0, help="of every recording")
    arguments = parser.parse_args()
    for line in lines(arguments.episodes, arguments.seed):
        sys.stdout.write(f"{line}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
