"""Franka kitchen: the two tasks of Table 1 of DILO's paper, offline data partial and mixed.

A return counts the scored sub-tasks that an episode completes, from 0 to 4, so the normalised score is their share in
per cent. The paper's code and its text differ in K, the expert trajectories that join the offline data: `SUITE` takes 1
as the code does whatever its arguments, and `PAPER` 30. D4RL's and Minari's files of complete demonstrations may hold
fewer than 30; then all of them join.

SMODICE's authors run SMODICE and ORIL with settings of their own here: the chi^2 divergence, no absorbing state and no
expert trajectory in the offline data. `SUITE` and `WITHOUT_GOAL` do so for these two; in `PAPER`, every method learns
from one mix. Their demonstration is one whole trajectory; here it is the task's, as for every method.

The kitchen goal-vector trap: in D4RL's files the expert rows of ``mixed`` carry another goal than the offline rows, so
the goal alone identifies them. `SUITE` keeps the goal, as the published experiments did; `WITHOUT_GOAL` is the same
with observations that end before it. Minari's have none. Generated data are made in the task's own environment: both
parts carry one goal, and leaving it out removes no such shortcut.

Generated data come from a scripted demonstrator, not from people. Its expert is D4RL's ``complete``: microwave,
kettle, light switch and slide cabinet, in this order; where ``mixed`` is scored, that is three of four, as in the
paper, and the episode goes on at rest. Offline, an episode completes up to four of six sub-tasks in random order
(without the hinge cabinet, which D4RL's people open, too), and under ``mixed`` never all that are scored.
"""

from __future__ import annotations

from dataclasses import replace

from lfobench.contract.suite import DataFile, Environment, Files, Recipe, Settings, Suite, Task
from suites import sources
from suites.franka import HORIZON, IDENTIFIER
from suites.franka.constants import OBJECTS, ROBOT, Layout, Variant
from suites.franka.demonstrator import load

VARIANTS: tuple[Variant, ...] = ("partial", "mixed")
OFFLINE_TRANSITIONS, DEMONSTRATION_ROWS = 136_950, 183
MINARI_TRANSITIONS = 156_560
"""All of either of Minari's datasets, as `OFFLINE_TRANSITIONS` are of D4RL's."""
PAPER_STEPS = 1_000_000
RELEASED_TRAJECTORIES, PAPER_TRAJECTORIES = 1, 30
SETTINGS: Settings = {"smodice": {"divergence": "chi2", "absorbing": False}, "oril": {"absorbing": False}}
"""Settings of SMODICE's authors for the kitchen."""


def _environment(variant: Variant, layout: Layout) -> Environment:
    arguments = {"variant": variant, "layout": layout}
    return Environment("kitchen", f"suites.franka.registration:{IDENTIFIER}", HORIZON, 0.0, 4.0, arguments)


def _d4rl(level: str, layout: Layout) -> DataFile:
    return replace(sources.d4rl_kitchen(level), columns=None if layout == "d4rl-with-goal" else ROBOT + OBJECTS)


def _files(variant: Variant, layout: Layout, recipe: Recipe) -> dict[str, Files]:
    found = {"d4rl": Files(offline=_d4rl(variant, layout), expert=_d4rl("complete", layout), returns=False)}
    if layout == "d4rl-with-goal":
        offline, expert = (sources.minari(f"D4RL/kitchen/{level}-v2") for level in (variant, "complete"))
        whole = replace(recipe, offline_transitions=MINARI_TRANSITIONS)
        found["minari"] = Files(offline, expert, _environment(variant, "minari"), whole, returns=False)
    return found


def _tasks(trajectories: int, layout: Layout) -> tuple[Task, ...]:
    tasks = []
    for variant in VARIANTS:
        recipe = Recipe(variant, OFFLINE_TRANSITIONS, "expert", trajectories, DEMONSTRATION_ROWS)
        tasks.append(
            Task(
                name=f"kitchen-{variant}-expert",
                group=f"{variant}+expert",
                environment=_environment(variant, layout),
                recipe=recipe,
                paper_steps=PAPER_STEPS,
                files=_files(variant, layout, recipe),
                settings=SETTINGS,
                without_expert=tuple(SETTINGS) if trajectories == RELEASED_TRAJECTORIES else (),
                simulator=("gymnasium-robotics",),
            )
        )
    return tuple(tasks)


SUITE = Suite(
    name="kitchen",
    summary="2 tasks of a robot arm in a kitchen: {partial, mixed} x {1 expert trajectory}",
    tasks=_tasks(RELEASED_TRAJECTORIES, "d4rl-with-goal"),
    demonstrator=load,
)

PAPER = Suite(
    name="kitchen-paper",
    summary="kitchen with the paper's 30 expert trajectories",
    tasks=_tasks(PAPER_TRAJECTORIES, "d4rl-with-goal"),
    demonstrator=load,
)

WITHOUT_GOAL = Suite(
    name="kitchen-without-goal",
    summary="kitchen without the goal in observations; in D4RL's files the goal identifies the expert",
    tasks=_tasks(RELEASED_TRAJECTORIES, "d4rl-without-goal"),
    demonstrator=load,
)
