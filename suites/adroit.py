"""Adroit: pen, door and hammer, as in Table 1 of DILO's paper.

{cloned, human} offline data, each with K = 30 expert trajectories.
Returns are those of D4RL's ``-v0`` environments, normalised with its references.

The paper's table writes a horizon of 100 for all three. D4RL's is 200 for door and hammer, and so is that of the
authors' code: `SUITE` has it, `PAPER` the table's, where generated and evaluated episodes, the demonstration and a
counted trajectory end at 100; episodes of files keep their length. D4RL's references are of whole episodes, so a score
of `PAPER` on door or hammer cannot be compared with others. Both take the
table's 5e6 transitions of pen-cloned, which has 500,000, for a misprint.

Generated data hold no human demonstrations: where D4RL has them, the level ``scripted`` takes their place.
"""

from __future__ import annotations

from dataclasses import replace

from lfobench.contract.suite import Environment, Files, Level, Recipe, Suite, Task
from suites import sources
from suites.hand import HORIZONS, identifier
from suites.hand.levels import demonstrator

RETURNS = {
    "pen": (96.262799, 3076.8331017826877),
    "door": (-56.512833, 2880.5693087298737),
    "hammer": (-274.856578, 12794.134825156867),
}
"""Returns of score 0 and score 100."""
ENVIRONMENTS = tuple(Environment(name, identifier(name), HORIZONS[name], *RETURNS[name]) for name in RETURNS)

PAPER_HORIZON = 100
EXPERT_TRAJECTORIES = 30
PAPER_STEPS = 500_000
OFFLINE_TRANSITIONS = {
    "cloned": {"pen": 500_000, "door": 1_000_000, "hammer": 1_000_000},
    "human": {"pen": 5_000, "door": 6_729, "hammer": 11_310},
}
# The smallest seed whose first expert episode, which becomes the demonstration, runs to the horizon and scores within
# half a std of the expert's mean on its card: a lone drop must not be what every method is asked to imitate.
GENERATION_SEEDS = {"pen": 2, "door": 0, "hammer": 0}
GENERATED: dict[str, Level] = {"cloned": "cloned", "human": "scripted"}
"""Level of D4RL's offline data to the generated level that takes its place."""


def _task(environment: Environment, offline: Level) -> Task:
    stand_in = GENERATED[offline]
    name = environment.name
    recipe = Recipe(
        offline=stand_in,
        offline_transitions=OFFLINE_TRANSITIONS[offline][name],
        expert="expert",
        expert_trajectories=EXPERT_TRAJECTORIES,
        demonstration_rows=environment.horizon,
    )
    real, group = replace(recipe, offline=offline), f"{offline}+expert"
    return Task(
        name=f"{name}-{offline}-expert",
        group=f"{stand_in}+expert",
        environment=environment,
        recipe=recipe,
        paper_steps=PAPER_STEPS,
        simulator=("gymnasium-robotics",),
        files={
            "d4rl": Files(
                sources.d4rl_adroit(name, offline), sources.d4rl_adroit(name, "expert"), recipe=real, group=group
            ),
            "minari": Files(
                offline=sources.minari(f"D4RL/{name}/{offline}-v2"),
                expert=sources.minari(f"D4RL/{name}/expert-v2"),
                recipe=real,
                group=group,
            ),
        },
    )


def _tasks(environments: tuple[Environment, ...]) -> tuple[Task, ...]:
    return tuple(_task(environment, offline) for offline in OFFLINE_TRANSITIONS for environment in environments)


SUITE = Suite(
    name="adroit",
    summary="6 tasks of a 24-joint hand: pen, door, hammer x {cloned, human} with 30 expert trajectories",
    tasks=_tasks(ENVIRONMENTS),
    demonstrator=demonstrator,
    generation_seeds=GENERATION_SEEDS,
)

PAPER = Suite(
    name="adroit-paper",
    summary="adroit with the paper's horizon of 100 for door and hammer, too",
    tasks=_tasks(tuple(replace(environment, horizon=PAPER_HORIZON) for environment in ENVIRONMENTS)),
    demonstrator=demonstrator,
    generation_seeds=GENERATION_SEEDS,
)
