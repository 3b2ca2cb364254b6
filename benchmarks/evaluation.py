"""Evaluation one environment at a time, in lock step and in worker processes; control steps of the robot simulation."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import gymnasium
import numpy as np
import torch
from torch import Tensor, nn

from benchmarks.authors.loop import perceptron
from benchmarks.hardware import describe
from benchmarks.pairs import Alternation, Contender, Spread, alternate
from lfobench.cells.cell import Cell
from lfobench.cells.plan import Request, make_plan
from lfobench.contract.method import Shapes
from lfobench.contract.suite import Environment
from lfobench.data.mixing import ObservationTransform
from lfobench.engine.evaluation import EpisodeResults, Evaluator, start_seed
from lfobench.engine.evaluation_workers import EvaluationWorkers
from lfobench.engine.state import MethodState, live_tensors
from lfobench.registry import load_suite

CPU = torch.device("cpu")
ONE_AT_A_TIME, LOCK_STEP, WORKERS = "one at a time", "lock step", "workers"
EPISODES, HORIZON = 10, 300
# Every episode must last to the horizon, so that all contenders take the same steps; an untrained hopper falls.
ARGUMENTS: dict[str, dict[str, Any]] = {"hopper": {"terminate_when_unhealthy": False}, "halfcheetah": {}}


@dataclass(frozen=True)
class EvaluationComparison:
    """The three ways of one evaluation, timed together.

    Attributes:
        environment: its short name.
        seeds: S.
        episodes: K per seed.
        horizon: steps of every episode.
        workers: processes of the third way.
        timing: per call, one evaluation.
    """

    environment: str
    seeds: int
    episodes: int
    horizon: int
    workers: int
    timing: Alternation

    @property
    def lock_step_speedup(self) -> Spread:
        """One at a time over lock step, one process each."""
        return self.timing.ratio(ONE_AT_A_TIME, LOCK_STEP)

    @property
    def workers_speedup(self) -> Spread:
        """One at a time over all cores."""
        return self.timing.ratio(ONE_AT_A_TIME, WORKERS)

    def steps_per_second(self, name: str) -> Spread:
        """Environment steps per second of one of the three."""
        steps = self.seeds * self.episodes * self.horizon
        return Spread.of([steps / seconds for seconds in self.timing.timings[name].seconds])

    def as_json(self) -> dict[str, Any]:
        """JSON data."""
        return {
            "environment": self.environment,
            "seeds": self.seeds,
            "episodes": self.episodes,
            "horizon": self.horizon,
            "workers": self.workers,
            "environment_steps_per_second": {
                name: self.steps_per_second(name).as_json() for name in self.timing.timings
            },
            "one_at_a_time_over_lock_step": self.lock_step_speedup.as_json(),
            "one_at_a_time_over_workers": self.workers_speedup.as_json(),
            "timings": self.timing.as_json(),
        }


def evaluate_one_at_a_time(
    policies: Sequence[nn.Module],
    transform: ObservationTransform,
    environment: gymnasium.Env[Any, Any],
    starts: Sequence[int],
) -> EpisodeResults:
    """The loop of the authors' scripts: reset, one observation to the policy, one action back, step.

    Args:
        policies: one per seed, ``[obs] -> [act]``.
        transform: from the simulator's observation to the policy's.
        environment: the one simulator.
        starts: seed of the reset of each episode.
    """
    returns = np.zeros((len(policies), len(starts)))
    lengths = np.zeros(returns.shape, np.int64)
    finite = np.ones(len(policies), np.bool_)
    for seed, policy in enumerate(policies):
        for episode, start in enumerate(starts):
            observation, _ = environment.reset(seed=start)
            over = False
            while not over:
                given = torch.from_numpy(transform(np.asarray(observation, np.float32)))
                with torch.no_grad():
                    action = policy(given).numpy()
                finite[seed] &= np.isfinite(action).all()
                observation, reward, terminated, truncated, _ = environment.step(action)
                returns[seed, episode] += float(reward)
                lengths[seed, episode] += 1
                over = terminated or truncated
    return EpisodeResults(returns, lengths, finite)


def compare_evaluation(
    environment: str, *, rounds: int = 5, horizon: int = HORIZON, workers: int | None = None, seeds: int | None = None
) -> EvaluationComparison:
    """The untrained policies of DILO, S seeds of them, evaluated in alternation by the three ways.

    Args:
        environment: ``hopper`` or ``halfcheetah``.
        rounds: evaluations by each way, after one that is not timed (it starts processes and makes simulators).
        horizon: steps of every episode.
        workers: processes; None for one per core.
        seeds: S; None for two per core, at least four.

    Raises:
        RuntimeError: when the three ways do not take the same steps.
    """
    cores = describe(CPU).cores
    workers, axis = workers or cores, range(seeds or max(2 * cores, 4))
    cell = _cell(environment, horizon)
    simulator = cell.task.environment.make()
    shapes = Shapes(
        *(int(np.prod(space.shape or ())) for space in (simulator.observation_space, simulator.action_space))
    )
    transform = ObservationTransform(
        np.zeros(shapes.observation, np.float32), np.ones(shapes.observation, np.float32), False
    )
    method = cell.method(cell.config, shapes, axis, CPU)
    policies = [_torch_policy(flat, shapes, cell) for flat in live_tensors(method)["policy.network"]]
    observation = torch.ones(len(axis), 1, shapes.observation)
    _check_policies(policies, observation, method.act(observation))
    evaluator = Evaluator(cell.task, transform, len(axis), range(EPISODES))
    pool = EvaluationWorkers(cell, transform, shapes, axis, workers)
    starts = [start_seed(cell.task, episode) for episode in range(EPISODES)]

    def by_workers() -> EpisodeResults:
        pool.submit(0, MethodState.of(method, shapes, len(axis)).capture())
        return pool.collect().results

    ways = {
        ONE_AT_A_TIME: lambda: evaluate_one_at_a_time(policies, transform, simulator, starts),
        LOCK_STEP: lambda: evaluator.evaluate(method, CPU),
        WORKERS: by_workers,
    }

    def whole(name: str) -> None:
        if (ways[name]().lengths != horizon).any():
            raise RuntimeError(f"{name}: an episode of {environment} did not last {horizon} steps")

    try:
        contenders = [Contender(name, lambda name=name: whole(name)) for name in ways]  # type: ignore[misc]
        timing = alternate(contenders, rounds=rounds, calls=1, warm_up=1)
    finally:
        pool.close()
        evaluator.close()
        simulator.close()
    return EvaluationComparison(environment, len(axis), EPISODES, horizon, min(workers, len(axis)), timing)


def _cell(environment: str, horizon: int) -> Cell:
    (cell,) = make_plan(Request("dilo", "locomotion", f"{environment}-random-expert", protocol="paper"), bool).cells
    timed = replace(cell.task.environment, horizon=horizon, arguments=ARGUMENTS[environment])
    return replace(
        cell,
        task=replace(cell.task, environment=timed),
        protocol=replace(cell.protocol, evaluation_episodes=EPISODES),
    )


def _torch_policy(flat: Tensor, shapes: Shapes, cell: Cell) -> nn.Sequential:
    """One seed's policy as the authors write it; `flat` holds each layer's weight ``[in, out]``, then its bias."""
    sizes = (shapes.observation, *cell.config.model_dump()["hidden"], shapes.action)
    policy = perceptron(sizes, output=nn.Tanh())
    layers = [layer for layer in policy if isinstance(layer, nn.Linear)]
    offset = 0
    with torch.no_grad():
        for layer, (fan_in, fan_out) in zip(layers, pairwise(sizes), strict=True):
            weight, bias = flat[offset : offset + (fan_in + 1) * fan_out].split([fan_in * fan_out, fan_out])
            layer.weight.copy_(weight.view(fan_in, fan_out).T)
            layer.bias.copy_(bias)
            offset += (fan_in + 1) * fan_out
    return policy


def _check_policies(policies: Sequence[nn.Module], observation: Tensor, expected: Tensor) -> None:
    """Both ways must run one policy; `observation` is ``[S, 1, obs]``, `expected` ``[S, 1, act]``."""
    with torch.no_grad():
        found = torch.stack([policy(given) for policy, given in zip(policies, observation, strict=True)])
    torch.testing.assert_close(found, expected)


WORLDS = 64
GENTLE = 0.2
"""Largest action: full ones stop the arm by its own emergency stop."""


def control_steps(quick: bool, rounds: int) -> dict[str, Spread]:
    """Control steps per second of one thread's time, by environment of the suite; resets are not counted."""
    environments = {
        f"{each.name} {' '.join(map(str, each.arguments.values()))}".strip(): each
        for each in (task.environment for task in load_suite("airhockey").tasks)
    }
    return {name: _control_steps(each, 10 if quick else 100, rounds) for name, each in environments.items()}


def _control_steps(environment: Environment, steps: int, rounds: int) -> Spread:
    worlds = environment.make_many(WORLDS)
    if worlds is None:
        raise RuntimeError(f"{environment.name} has no vector form")
    actions = np.random.default_rng(0).uniform(-GENTLE, GENTLE, (steps, WORLDS, 2)).astype(np.float32)
    rates = []
    for _ in range(rounds):
        worlds.reset(seed=0)
        # The thread's own time: what others do on the machine is not the simulation's.
        started = time.thread_time()
        for action in actions:
            worlds.step(action)
        rates.append(steps * WORLDS / (time.thread_time() - started))
    worlds.close()
    return Spread.of(rates)
