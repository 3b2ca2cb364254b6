"""Scores and lengths of the kitchen's scripted demonstrator: ``python -m tools.kitchen_measure``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator

import numpy as np

from suites.franka.demonstrator import load
from suites.kitchen import SUITE
from tools.locomotion_measure import returns_and_lengths, standard_error


def levels(episodes: int) -> Iterator[str]:
    """Lines on both parts of both tasks: score ± standard error, steps of an episode, share with all four sub-tasks."""
    for task in SUITE.tasks:
        for level in (task.recipe.expert, task.recipe.offline):
            returns, lengths = returns_and_lengths(task.environment, load("kitchen", level).act, episodes)
            scores = np.array([task.environment.normalized_score(value) for value in returns])
            yield (
                f"{task.name} {level}: {scores.mean():.1f} ± {standard_error(scores):.1f}, "
                f"{lengths.min():.0f} to {lengths.max():.0f} steps ({lengths.mean():.0f}), "
                f"all four {(scores == 100).mean():.2f}"
            )


def main() -> None:
    """Print everything."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--episodes", type=int, default=100, help="per level")
    for line in levels(parser.parse_args().episodes):
        sys.stdout.write(f"{line}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
