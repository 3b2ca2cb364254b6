"""Locomotion: hopper, halfcheetah, walker2d and ant, as in Table 1 of DILO's paper.

{random, medium} x {expert: K = 200 trajectories, few-expert: K = 30}, one million offline transitions each.
Returns are those of Gymnasium's ``-v5`` environments, normalised with D4RL's references.
Ant is the 27-dimensional form: D4RL's other 84 columns are zero.

For walker2d, SMODICE's and ReCOIL's code mixes in 100 expert trajectories where the paper and DILO's have 200:
`SUITE` has 200, `SMODICE` 100.

D4RL's files were made on ``-v2``, to which ``-v4`` is the closest that still runs; Minari's
``mujoco/*`` datasets are other data, made on ``-v5``, and have nothing random.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from lfobench.contract.suite import Environment, Files, Level, Recipe, Suite, Task
from suites import sources
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


# Columns of the body's own state, the first of D4RL's 111 and of Minari's 105 columns of ant.
COLUMNS = {"ant": 27}


def on_version_4(environment: Environment) -> Environment:
    """The environment's older version, without the contact forces that it could be asked for."""
    return replace(environment, id=environment.id.replace("-v5", "-v4"), arguments={})


def _files(environment: Environment, offline: Level) -> dict[str, Files]:
    name, columns = environment.name, COLUMNS.get(environment.name)
    found = {
        "d4rl": Files(
            offline=sources.d4rl_locomotion(name, offline, columns),
            expert=sources.d4rl_locomotion(name, "expert", columns),
            environment=on_version_4(environment),
        )
    }
    if offline != "random":
        medium, expert = (sources.minari(f"mujoco/{name}/{level}-v0", columns) for level in (offline, "expert"))
        found["minari"] = Files(offline=medium, expert=expert)
    return found


def _task(environment: Environment, offline: Level, mix: str, trajectories: int) -> Task:
    recipe = Recipe(
        offline=offline,
        offline_transitions=1_000_000,
        expert="expert",
        expert_trajectories=trajectories,
        demonstration_rows=environment.horizon,
    )
    return Task(
        name=f"{environment.name}-{offline}-{mix}",
        group=f"{offline}+{mix}",
        environment=environment,
        recipe=recipe,
        paper_steps=PAPER_STEPS[mix],
        files=_files(environment, offline),
    )


def _tasks(exceptions: Mapping[tuple[str, str], int]) -> tuple[Task, ...]:
    """All 16, with K as an exception for an environment and a mix has it."""
    return tuple(
        _task(environment, offline, mix, exceptions.get((environment.name, mix), trajectories))
        for offline in OFFLINE_LEVELS
        for mix, trajectories in EXPERT_TRAJECTORIES.items()
        for environment in ENVIRONMENTS
    )


SUITE = Suite(
    name="locomotion",
    summary="16 MuJoCo tasks: 4 bodies x {random, medium} x {200, 30 expert trajectories}",
    tasks=_tasks({}),
    demonstrator=load,
    generation_seeds=GENERATION_SEEDS,
)

SMODICE = Suite(
    name="locomotion-smodice",
    summary="locomotion with 100 expert trajectories for walker2d in place of 200, as SMODICE's code has it",
    tasks=_tasks({("walker2d", "expert"): 100}),
    demonstrator=load,
    generation_seeds=GENERATION_SEEDS,
)
