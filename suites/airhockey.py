"""Air hockey: the robot tasks of DILO's paper on a simulated table.

Ten tasks: safe manipulation by teleoperation and across embodiments, each with {15 trajectories, 15 from one corner,
300 transitions}; puck striking with 20 and with 10 expert trajectories; dynamic hitting with 400, scored as touch and
as hit. Where the paper's two accounts of the data differ, the main text is `SUITE` (as many offline transitions as the
experts recorded) and the appendix is `APPENDIX` (50 offline trajectories, other expert sets).

A return is 1 for a success and 0 otherwise, so the normalised score is the success rate in per cent.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from lfobench.contract.suite import Budget, Environment, Level, Recipe, Suite, Task
from suites.robot import constants
from suites.robot.demonstrators import SINGLE_HITS, demonstrator
from suites.robot.scene import scene

# The paper gives no gradient steps for the robot; these are for a GPU, with the released hyperparameters.
PAPER_STEPS = 50_000
FIXED_STARTS, STRIKING_STARTS, FURTHER_STARTS = 10, 11, 100


def _budgets(starts: int) -> dict[str, Budget]:
    return {
        "paper": Budget(PAPER_STEPS, 5_000, starts, FURTHER_STARTS),
        "quick": Budget(1_500, 500, starts, FURTHER_STARTS, methods="demo"),
        "demo": Budget(1_000, 500, starts, FURTHER_STARTS, methods="demo"),
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
OFFLINE_HITTING = 120
"""Offline trajectories of dynamic hitting; more than the main text's equal share."""


def _task(environment: Environment, group: str, level: Level, trajectories: int, offline: int, **recipe: Any) -> Task:
    return Task(
        name=f"{environment.name}-{group}",
        group=group,
        environment=environment,
        recipe=Recipe.recorded(
            _judged("suboptimal", environment),
            offline,
            _judged(level, environment),
            trajectories,
            standardize=True,
            **recipe,
        ),
        paper_steps=PAPER_STEPS,
        budgets=_budgets(STRIKING_STARTS if environment is STRIKING else FIXED_STARTS),
        settings=SETTINGS,
        grids=GRIDS,
    )


def _judged(level: Level, environment: Environment) -> Level:
    """Recordings succeed or fail by the task's own score."""
    return f"{level}-touch" if environment is TOUCH else level


def _manipulation(environment: Environment, level: Level, equal: bool) -> tuple[Task, ...]:
    size, common = (SAFE_TRAJECTORIES, OFFLINE_TRAJECTORIES), {"equal_transitions": equal}
    if environment is CROSS:
        common["expert_actions"] = False
    return (
        _task(environment, "few-trajectories", level, *size, **common),
        _task(environment, "fixed-start", f"{level}-fixed", *size, **common),
        _task(environment, "few-uniform", level, *size, **common, expert_transitions=UNIFORM_TRANSITIONS),
    )


SUITE = Suite(
    name="airhockey",
    summary="10 robot tasks on a simulated air-hockey table: safe manipulation, puck striking, dynamic hitting",
    tasks=(
        *_manipulation(SAFE, "expert", equal=True),
        *(
            _task(STRIKING, f"{count}-expert", "expert", count, OFFLINE_TRAJECTORIES, equal_transitions=True)
            for count in (20, 10)
        ),
        *_manipulation(CROSS, "hand", equal=True),
        *(
            _task(environment, f"{HITS}-expert-{score}", "expert", HITS, OFFLINE_HITTING, equal_transitions=True)
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
        *_manipulation(SAFE, "expert", equal=False),
        _task(STRIKING, f"{APPENDIX_STRIKES}-expert", "expert", APPENDIX_STRIKES, OFFLINE_TRAJECTORIES),
        *_manipulation(CROSS, "hand", equal=False),
        *(
            _task(
                environment, f"{APPENDIX_HITS}-expert-{score}", "expert-repeated", APPENDIX_HITS, OFFLINE_TRAJECTORIES
            )
            for score, environment in (("touch", TOUCH), ("hit", HIT))
        ),
    ),
    demonstrator=demonstrator,
    scene=scene,
)
