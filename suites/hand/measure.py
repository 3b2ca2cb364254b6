"""How true the environments are, and who acts in them how well: ``python -m suites.hand.measure --data FOLDER``.

The folder holds rollouts ``{pen,door,hammer}-external-expert.hdf5`` of the policies ``policies/*-dapg.npz``, and
``door-human-dapg.hdf5``. Without it, only this project's own policies are measured. Every ± is a standard error; a
success is lasting if D4RL's own account has it (`LASTING`).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from lfobench.contract.suite import Environment
from suites.adroit import ENVIRONMENTS
from suites.demonstrators.measure import Difference, without_noise
from suites.demonstrators.teacher import read_teacher
from suites.hand import HORIZONS
from suites.hand.levels import LEVELS, demonstrator
from suites.hand.replay import FIRST_SEED, Played, act_out, open_loop, recorded, step_by_step


def against_files(data: Path, episodes: int) -> Iterator[str]:
    """Teachers here and in their files, from the same starts; then the files' steps, and the human demonstrations."""
    yield "teachers, mean action; difference here less file, paired by start"
    for environment in ENVIRONMENTS:
        yield from _teacher(data, environment, episodes)
    yield "steps from their stored states: difference of rewards and of next observations, median and 99 %"
    for name, horizon in HORIZONS.items():
        for part, steps in (("first", 1), ("all", horizon)):
            found = step_by_step(name, _file(data, name), range(min(episodes, 10)), steps)
            reward, observation = (np.quantile(each, [0.5, 0.99]) for each in found)
            yield f"  {name:8}{part:6}{reward[0]:.1e}, {reward[1]:.1e}; {observation[0]:.1e}, {observation[1]:.1e}"
    human = data / "door-human-dapg.hdf5"
    yield "human demonstrations of door, open loop from their stored states"
    there = recorded("door", human)
    every = range(len(there.returns))
    yield f"  whole: here {_words(open_loop(human, every))}; file {there.returns.mean():.1f}"
    yield f"  first {HORIZONS['door']} steps: here {_words(open_loop(human, every, HORIZONS['door']))}"


def _teacher(data: Path, environment: Environment, episodes: int) -> Iterator[str]:
    name = environment.name
    there = recorded(name, _file(data, name)).first(episodes)
    act = without_noise(read_teacher(data / "policies" / f"{name}-dapg.npz").mean_action)
    here = act_out(environment, act, range(FIRST_SEED, FIRST_SEED + len(there.returns)))
    apart = Difference.between(here.returns, there.returns)
    yield f"  {name:8}here {_words(here)}; file {_words(there)}"
    yield (
        f"  {'':8}difference {apart.mean:+.2f} ± {apart.error:.2f}, median size {apart.median_size:.2g}; "
        f"{abs(apart.mean) / apart.unpaired_error:.2f} standard errors apart if unpaired"
    )


def _file(data: Path, name: str) -> Path:
    return data / f"{name}-external-expert.hdf5"


def _words(played: Played) -> str:
    success = f"success {played.success:.3f}, lasting {played.lasting_success:.3f}"
    return f"{played.returns.mean():.1f} ± {played.standard_error:.1f}, {success}"


def own(episodes: int) -> Iterator[str]:
    """The policies behind the generated data, as they make it."""
    yield f"generated levels, {episodes} episodes: return, success, score"
    for environment in ENVIRONMENTS:
        for level in LEVELS:
            played = act_out(environment, demonstrator(environment.name, level).act, range(episodes))
            score = environment.normalized_score(float(played.returns.mean()))
            error = 100.0 * played.standard_error / (environment.expert_return - environment.random_return)
            yield f"  {environment.name:8}{level:10}{_words(played)}, score {score:.1f} ± {error:.1f}"


def main() -> None:
    """Print everything."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, help="folder of the external files")
    parser.add_argument("--episodes", type=int, default=40, help="per policy; of a file, at most what it has")
    arguments = parser.parse_args()
    sections = [own(arguments.episodes)]
    if arguments.data is not None:
        sections.insert(0, against_files(arguments.data, arguments.episodes))
    for section in sections:
        for line in section:
            sys.stdout.write(f"{line}\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
