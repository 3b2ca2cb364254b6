"""What the scripted demonstrator's data are: ``python -m suites.franka.measure``."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator

import numpy as np

from lfobench.contract.suite import Recipe
from lfobench.data.generated import roll_out
from lfobench.plan.parts import specification
from suites.demonstrators.measure import standard_error
from suites.franka.demonstrator import load
from suites.kitchen import SUITE


def levels(shards: int) -> Iterator[str]:
    """Of both parts of both tasks: episodes, score and its standard error, steps of an episode, and who does it all."""
    for task in SUITE.tasks:
        assert isinstance(task.recipe, Recipe)
        for level in (task.recipe.expert, task.recipe.offline):
            part, demonstrator = specification(SUITE, task, level), load("kitchen", level)
            made = [roll_out(part, demonstrator, shard) for shard in range(shards)]
            returns = np.concatenate([each.returns() for each in made]).astype(np.float64)
            lengths = np.concatenate([each.lengths for each in made])
            scores = np.array([task.environment.normalized_score(value) for value in returns])
            yield (
                f"{task.name} {level}: {len(scores)} episodes, {scores.mean():.1f} ± {standard_error(scores):.1f}, "
                f"{lengths.min()} to {lengths.max()} steps ({lengths.mean():.0f}), all four {(scores == 100).mean():.2f}"
            )


def main() -> None:
    """Print everything."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--shards", type=int, default=3, help="of 10,000 steps, per level")
    for line in levels(parser.parse_args().shards):
        sys.stdout.write(f"{line}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
