"""Suboptimal and expert rows around the states of the expert and of standing still, counted.

``python -m tools.neighbours halfcheetah-random-expert``. A ball around a state, in standardised observations, is as
wide as it takes to hold `NEAREST` rows of the offline data, expert trajectories included; the table has the share of
the expert's among them. A policy that clones the mix averages over all of them.
"""

from __future__ import annotations

import sys

import numpy as np
from scipy.spatial import cKDTree

from lfobench.cells.cell import load_protocol
from lfobench.contract.episodes import Episodes, FloatArray
from lfobench.contract.suite import Environment
from lfobench.data.source import load_task
from lfobench.files import cache_folder
from lfobench.registry import load_suite

SUITE = "locomotion"
STEPS = (0, 1, 2, 3, 5, 10, 20, 50, 200)
NEAREST, EPISODES = 200, 50


def rows_with_action(episodes: Episodes) -> FloatArray:
    """``[N, obs]`` the observations in which an action was taken."""
    rows: FloatArray = episodes.observations[episodes.observation_of_transition]
    return rows


def standing_still(environment: Environment, steps: int) -> FloatArray:
    """``[EPISODES, steps + 1, obs]`` states of episodes without any action."""
    built = environment.make()
    nothing = np.zeros(built.action_space.shape or (), np.float32)
    states = []
    for seed in range(EPISODES):
        states.append([built.reset(seed=seed)[0]])
        states[-1] += [built.step(nothing)[0] for _ in range(steps)]
    built.close()
    return np.array(states, np.float32)


def expert_states(expert: Episodes, steps: int) -> FloatArray:
    """``[EPISODES, steps + 1, obs]`` states of the first episodes that are as long."""
    first = expert.first_observation[expert.lengths > steps][:EPISODES]
    states: FloatArray = expert.observations[first[:, None] + np.arange(steps + 1)]
    return states


def expert_share(offline: Episodes, expert: Episodes, states: FloatArray) -> FloatArray:
    """``[n]`` share of the expert's rows among the `NEAREST` ones of each state ``[n, obs]``."""
    rows = np.concatenate([rows_with_action(expert), rows_with_action(offline)])
    mean, std = rows.mean(0), rows.std(0) + 1e-3
    nearest = cKDTree((rows - mean) / std).query((states - mean) / std, NEAREST)[1]
    share: FloatArray = (nearest < expert.transitions).mean(1)
    return share


def main() -> None:
    """Print the table."""
    name, protocol = sys.argv[1], load_protocol(sys.argv[2] if len(sys.argv) > 2 else "quick")
    suite = load_suite(SUITE)
    task = next(task for task in suite.tasks if task.name == name)
    recipe = protocol.recipe_for(task)
    build = f"lfobench data build {SUITE} --tasks {name} --protocol {protocol.name}"
    data = load_task(cache_folder(), suite, task, recipe, build)
    expert = data.expert.first_episodes(recipe.expert_trajectories)
    sys.stdout.write(f"{'step':>6}  % of expert rows near the expert, and near standing still: quartiles\n")
    visited = expert_states(expert, STEPS[-1]), standing_still(task.environment, STEPS[-1])
    for step in STEPS:
        quartiles = [
            np.quantile(100.0 * expert_share(data.offline, expert, states[:, step]), (0.25, 0.5, 0.75))
            for states in visited
        ]
        columns = ["  ".join(f"{value:5.1f}" for value in found) for found in quartiles]
        sys.stdout.write(f"{step:>6}  {columns[0]}     {columns[1]}\n")


if __name__ == "__main__":
    main()
