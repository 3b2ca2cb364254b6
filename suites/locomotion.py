"""Locomotion: hopper, halfcheetah, walker2d and ant, as in the seed paper's Table 1 (methods.md 2.5).

{random, medium} x {expert: K = 200 trajectories, few-expert: K = 30}, one million offline transitions each.
Returns are those of Gymnasium's ``-v5`` environments, normalised with D4RL's references (methods.md 5.1).
Ant is the 27-dimensional form: D4RL's other 84 columns are zero.
"""

from __future__ import annotations

from lfobench.contract.suite import Environment, Level, Recipe, Suite, Task
from suites.demonstrators import load

ENVIRONMENTS = (
    Environment("hopper", "Hopper-v5", 1000, -20.272305, 3234.3),
    Environment("halfcheetah", "HalfCheetah-v5", 1000, -280.178953, 12135.0),
    Environment("walker2d", "Walker2d-v5", 1000, 1.629008, 4592.3),
    Environment("ant", "Ant-v5", 1000, -325.6, 3879.7, {"include_cfrc_ext_in_observation": False}),
)

EXPERT_TRAJECTORIES = {"expert": 200, "few-expert": 30}
PAPER_STEPS = {"expert": 300_000, "few-expert": 500_000}
# The smallest seed whose first expert episode, which becomes the demonstration, runs to the horizon and scores
# within one std of the expert's mean on its card: a lone fall must not be what every method is asked to imitate.
GENERATION_SEEDS = {"hopper": 0, "halfcheetah": 0, "walker2d": 2, "ant": 0}
OFFLINE_LEVELS: tuple[Level, ...] = ("random", "medium")


def _task(environment: Environment, offline: Level, mix: str) -> Task:
    recipe = Recipe(
        offline=offline,
        offline_transitions=1_000_000,
        expert="expert",
        expert_trajectories=EXPERT_TRAJECTORIES[mix],
        demonstration_rows=environment.horizon,
    )
    return Task(
        name=f"{environment.name}-{offline}-{mix}",
        group=f"{offline}+{mix}",
        environment=environment,
        recipe=recipe,
        paper_steps=PAPER_STEPS[mix],
    )


SUITE = Suite(
    name="locomotion",
    summary="16 MuJoCo tasks: 4 bodies x {random, medium} x {200, 30 expert trajectories}",
    tasks=tuple(
        _task(environment, offline, mix)
        for offline in OFFLINE_LEVELS
        for mix in EXPERT_TRAJECTORIES
        for environment in ENVIRONMENTS
    ),
    demonstrator=load,
    generation_seeds=GENERATION_SEEDS,
)
