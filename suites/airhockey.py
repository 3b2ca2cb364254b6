"""Air hockey: the robot tasks of DILO's paper on a simulated table.

Ten tasks: safe manipulation by teleoperation and across embodiments, each with {15 trajectories, 15 from one corner,
300 transitions}; puck striking with 20 and with 10 expert trajectories; dynamic hitting with 400, scored as touch and
as hit. Where the paper's two accounts of the data differ, the main text is `SUITE` ("the same amount of transitions as
the expert dataset, a mix of successes and failures": half of the offline recordings succeed) and the appendix is
`APPENDIX` (50 offline trajectories that ignore the task, other expert sets). `SHARE` has three of the main text's tasks
with every share of successes from none to all.

A return is 1 for a success and 0 otherwise, so the normalised score is the success rate in per cent.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from lfobench.contract.suite import Budget, Environment, Level, Recipe, Suite, Task
from suites.robot import constants
from suites.robot.demonstrators import SINGLE_HITS, SUCCESS_SHARES, demonstrator
from suites.robot.scene import scene

# The paper gives no gradient steps for the robot; these are for a GPU, with the released hyperparameters.
PAPER_STEPS = 50_000
FIXED_STARTS, FURTHER_STARTS = 50, 50
"""Test starts of every evaluation, and those of the final one alone: ten starts do not stand for a hundred."""
PUBLISHED_STARTS, PUBLISHED_STRIKING_STARTS = 10, 11
"""Those of the paper's table; they are the first ones."""


BUDGETS: Mapping[str, Budget] = {
    "paper": Budget(PAPER_STEPS, 5_000, FIXED_STARTS, FURTHER_STARTS),
    "quick": Budget(1_500, 500, FIXED_STARTS, FURTHER_STARTS, methods="demo"),
    "demo": Budget(1_000, 500, FIXED_STARTS, FURTHER_STARTS, methods="demo"),
    "smoke": Budget(40, 20, 2),
}


# The paper counts the passes of the discriminators and of the inverse dynamics model (the grids below) and no batches.
# Over a few hundred to a few thousand rows, only small batches make such a pass more than a handful of steps.
SMALL_BATCH = 32
SETTINGS: Mapping[str, Mapping[str, Any]] = {
    "smodice": {"discriminator_passes": 5, "discriminator_batch": SMALL_BATCH},
    "oril": {"discriminator_passes": 5, "discriminator_batch": SMALL_BATCH},
    "bco": {"inverse_dynamics_epochs": 5, "inverse_dynamics_batch_size": SMALL_BATCH},
}
# What the paper tuned on the robot.
GRIDS: Mapping[str, Mapping[str, tuple[Any, ...]]] = {
    "bco": {"inverse_dynamics_epochs": (1, 5, 10)},
    "smodice": {"discriminator_passes": (1, 5), "gradient_penalty": (1.0, 5.0, 10.0, 20.0)},
    "dilo": {"conservatism": (0.5, 0.6, 0.7, 0.8)},
}


def _environment(name: str, identifier: str, horizon: float, **arguments: Any) -> Environment:
    return Environment(name, f"suites.robot.registration:lfobench/{identifier}-v0", int(horizon), 0.0, 1.0, arguments)


SAFE = _environment("safe-manipulation", "SafeManipulation", constants.SAFE_HORIZON)
CROSS = _environment(
    "safe-manipulation-cross-embodiment", "SafeManipulation", constants.SAFE_HORIZON, embodiment="hand"
)
STRIKING = _environment("puck-striking", "PuckStriking", constants.STRIKING_HORIZON)
TOUCH, HIT = (
    _environment("dynamic-hitting", "DynamicHitting", constants.HITTING_HORIZON, score=score)
    for score in ("touch", "hit")
)

SAFE_TRAJECTORIES, UNIFORM_TRANSITIONS, HITS = 15, 300, 400
"""Expert data of the main text."""
APPENDIX_STRIKES, APPENDIX_HITS = 400, SINGLE_HITS + 850
OFFLINE_TRAJECTORIES = 50
"""Offline trajectories of the appendix; more than the main text's equal share of any task but hitting."""
OFFLINE_HITTING = 200
"""Offline trajectories of dynamic hitting; more than the main text's equal share, also if one in four succeeds."""
OFFLINE_SUCCESSFUL_HITS = 560
"""More than the main text's equal share if all succeed and are as short as the experts'."""
APPENDIX_LEVEL, MAIN_LEVEL = "suboptimal", "half-successful"


def _task(
    environment: Environment,
    group: str,
    level: Level,
    trajectories: int,
    offline: int,
    offline_level: Level,
    **recipe: Any,
) -> Task:
    return Task(
        name=f"{environment.name}-{group}",
        group=group,
        environment=environment,
        recipe=Recipe.recorded(
            _judged(offline_level, environment),
            offline,
            _judged(level, environment),
            trajectories,
            success_share=SUCCESS_SHARES.get(offline_level),
            standardize=True,
            **recipe,
        ),
        paper_steps=PAPER_STEPS,
        budgets=BUDGETS,
        published_starts=PUBLISHED_STRIKING_STARTS if environment is STRIKING else PUBLISHED_STARTS,
        settings=SETTINGS,
        grids=GRIDS,
    )


def _judged(level: Level, environment: Environment) -> Level:
    """Recordings succeed or fail by the task's own score."""
    return f"{level}-touch" if environment is TOUCH else level


def _main_text(
    environment: Environment, group: str, level: Level, trajectories: int, offline: int, **recipe: Any
) -> Task:
    recipe = {"offline_level": MAIN_LEVEL, **recipe}
    return _task(environment, group, level, trajectories, offline, equal_transitions=True, **recipe)


def _appendix(
    environment: Environment, group: str, level: Level, trajectories: int, offline: int, **recipe: Any
) -> Task:
    return _task(environment, group, level, trajectories, offline, APPENDIX_LEVEL, **recipe)


def _manipulation(environment: Environment, level: Level, make: Callable[..., Task]) -> tuple[Task, ...]:
    size, common = (SAFE_TRAJECTORIES, OFFLINE_TRAJECTORIES), {"expert_actions": environment is not CROSS}
    return (
        make(environment, "few-trajectories", level, *size, **common),
        make(environment, "fixed-start", f"{level}-fixed", *size, **common),
        make(environment, "few-uniform", level, *size, **common, expert_transitions=UNIFORM_TRANSITIONS),
    )


SUITE = Suite(
    name="airhockey",
    summary="10 robot tasks on a simulated air-hockey table: safe manipulation, puck striking, dynamic hitting",
    tasks=(
        *_manipulation(SAFE, "expert", _main_text),
        *(_main_text(STRIKING, f"{count}-expert", "expert", count, OFFLINE_TRAJECTORIES) for count in (20, 10)),
        *_manipulation(CROSS, "hand", _main_text),
        *(
            _main_text(environment, f"{HITS}-expert-{score}", "expert", HITS, OFFLINE_HITTING)
            for score, environment in (("touch", TOUCH), ("hit", HIT))
        ),
    ),
    demonstrator=demonstrator,
    scene=scene,
)

APPENDIX = Suite(
    name="airhockey-appendix",
    summary="airhockey with the data of the paper's appendix: 50 offline trajectories, 400 strikes, 900 hits",
    tasks=(
        *_manipulation(SAFE, "expert", _appendix),
        _appendix(STRIKING, f"{APPENDIX_STRIKES}-expert", "expert", APPENDIX_STRIKES, OFFLINE_TRAJECTORIES),
        *_manipulation(CROSS, "hand", _appendix),
        *(
            _appendix(
                environment, f"{APPENDIX_HITS}-expert-{score}", "expert-repeated", APPENDIX_HITS, OFFLINE_TRAJECTORIES
            )
            for score, environment in (("touch", TOUCH), ("hit", HIT))
        ),
    ),
    demonstrator=demonstrator,
    scene=scene,
)

SHARE = Suite(
    name="airhockey-share",
    summary="3 tasks of airhockey, with 0, 25, 50, 75 and 100 % of successes among the offline recordings",
    tasks=tuple(
        _main_text(environment, f"{group}-{offline}", "expert", trajectories, recordings, offline_level=offline)
        for environment, group, trajectories, recordings in (
            (SAFE, "few-trajectories", SAFE_TRAJECTORIES, OFFLINE_TRAJECTORIES),
            (STRIKING, "20-expert", 20, OFFLINE_TRAJECTORIES),
            (HIT, f"{HITS}-expert-hit", HITS, OFFLINE_SUCCESSFUL_HITS),
        )
        for offline in SUCCESS_SHARES
    ),
    demonstrator=demonstrator,
    scene=scene,
)
