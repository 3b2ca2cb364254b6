"""How much it matters which version of a MuJoCo environment a policy is evaluated on: ``-v4`` against ``-v5``.

D4RL's files are evaluated on ``-v4``, generated data and Minari's on ``-v5``. The same policies from the same seeds::

    python -m suites.demonstrators.versions --episodes 20
"""

from __future__ import annotations

import argparse
import sys

import numpy as np

from lfobench.contract.suite import Environment
from suites.demonstrators import load
from suites.demonstrators.measure import Measurement, measure
from suites.locomotion import ENVIRONMENTS, on_version_4


def level_on(environment: Environment, level: str, episodes: int) -> Measurement:
    """The level of a demonstrator in an environment, its actions sampled."""
    return measure(environment, load(environment.name, level).act, episodes)


def main() -> None:
    """Print one line per body and level."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=20)
    episodes: int = parser.parse_args().episodes
    sys.stdout.write("body         level    score on -v4     score on -v5     difference (standard error)\n")
    for environment in ENVIRONMENTS:
        for level in ("medium", "expert"):
            four, five = (level_on(each, level, episodes) for each in (on_version_4(environment), environment))
            difference = four.score_mean - five.score_mean
            error = float(np.hypot(four.score_std, five.score_std)) / max(episodes - 1, 1) ** 0.5
            scores = "   ".join(f"{each.score_mean:6.1f} ± {each.score_std:5.1f}" for each in (four, five))
            sys.stdout.write(f"{environment.name:12} {level:8} {scores}   {difference:+6.1f} ({error:.1f})\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
