"""How many episodes of random actions make a clone of 200 expert trajectories stand still?

``lfobench run --suite docs/standing_still.py --methods bc --protocol quick``: halfcheetah's recipe with 1, 10 or 100
episodes of the random part in place of 1000.
"""

from __future__ import annotations

from dataclasses import replace

from lfobench.contract.suite import Suite, Task
from suites.locomotion import SUITE as LOCOMOTION

EPISODES = (1, 10, 100)


def _task(episodes: int) -> Task:
    original = next(task for task in LOCOMOTION.tasks if task.name == "halfcheetah-random-expert")
    recipe = replace(original.recipe, offline_transitions=episodes * original.environment.horizon)
    return replace(original, name=f"halfcheetah-{episodes}-random-expert", group=f"{episodes} random", recipe=recipe)


SUITE = Suite(
    name="standing-still",
    summary="halfcheetah with 1, 10 and 100 episodes of random actions and 200 expert trajectories",
    tasks=tuple(map(_task, EPISODES)),
    demonstrator=LOCOMOTION.demonstrator,
    generation_seeds=LOCOMOTION.generation_seeds,
)
