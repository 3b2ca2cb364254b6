"""Effect of the MuJoCo environments' version, ``-v4`` or ``-v5``, on the scores of policies.

D4RL's files are evaluated on ``-v4``, generated data and Minari's on ``-v5``. The same policies from the same seeds::

    python -m tools.simulator_versions --episodes 20
"""

from __future__ import annotations

import argparse
import sys

import numpy as np

from lfobench.contract.suite import Environment
from suites.demonstrators import load
from suites.locomotion import ENVIRONMENTS, on_version_4
from tools.locomotion_measure import Array, Difference, returns_and_lengths


def scores_on(environment: Environment, level: str, episodes: int) -> Array:
    """Scores ``[episodes]`` of a demonstrator in an environment, its actions sampled."""
    returns, _ = returns_and_lengths(environment, load(environment.name, level).act, episodes)
    return np.array([environment.normalized_score(value) for value in returns])


def main() -> None:
    """Print one line per body and level; the score's ± is its std, the difference's a standard error."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--episodes", type=int, default=20)
    episodes: int = parser.parse_args().episodes
    sys.stdout.write("body         level    score on -v4     score on -v5     difference (error if unpaired)\n")
    for environment in ENVIRONMENTS:
        for level in ("medium", "expert"):
            four, five = (scores_on(each, level, episodes) for each in (on_version_4(environment), environment))
            apart = Difference.between(four, five)
            scores = "   ".join(f"{each.mean():6.1f} ± {each.std():5.1f}" for each in (four, five))
            difference = f"{apart.mean:+6.2f} ± {apart.error:.2f} ({apart.unpaired_error:.1f})"
            sys.stdout.write(f"{environment.name:12} {level:8} {scores}   {difference}\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
