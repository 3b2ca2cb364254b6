"""The check of a method against its contract, on random data, before it trains: each rule with a name.

A method that breaks a rule would train to wrong numbers without a word: resume from other weights, be evaluated
untrained, or depend on which seeds train beside it.
"""

from __future__ import annotations

import inspect
import random
import shlex
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from torch.utils._python_dispatch import TorchDispatchMode

from lfobench.contract.method import DataNeeds, Method, Metrics, Shapes, Stage, Trajectories, budget_fields
from lfobench.data.firewall import FirewallError, View, check_declaration
from lfobench.engine.batches import RunningStep, StageSampler
from lfobench.engine.probe import random_view
from lfobench.engine.state import (
    MethodState,
    SeedState,
    StateError,
    StateLayout,
    held_tensors,
    host,
    live_tensors,
    state_layout,
)
from lfobench.errors import UserError
from lfobench.randomness import Randomness
from lfobench.registry import declaration_faults

if TYPE_CHECKING:
    from torch import Tensor

SHAPES = Shapes(observation=11, action=3)
SEEDS = (7, 3, 11)
"""The seed that also trains alone is not the first, so that an axis that is ignored is noticed."""

ALONE = 1
ROWS = 600
UPDATES = 4
PROBES = 5
EPISODES, STEPS = 6, 20

READS_BACK = "an update turns no tensor into a Python number, and changes tensors in place"


@dataclass(frozen=True)
class Finding:
    """A rule, and what came of it.

    Attributes:
        rule: its name, as a statement that holds for a right method.
        problem: why it does not hold; empty where it does.
        fatal: whether a method that breaks it may not train; the others only cost time.
    """

    rule: str
    problem: str = ""
    fatal: bool = True


class _Broken(Exception):
    """The rule that is being checked does not hold."""


def check_method(method: type[Method], config: Any = None, shapes: Shapes = SHAPES) -> list[Finding]:
    """Every rule of the contract in the order in which they build on each other; ends with the first that is broken.

    Args:
        method: its class.
        config: of the method; None takes the defaults, as small as its ``smoke`` budget makes them.
        shapes: of the raw observations and actions.
    """
    findings: list[Finding] = []
    check = _Check(method, config, shapes)
    for rule, holds in check.rules():
        try:
            problem = holds()
        except (_Broken, StateError, FirewallError, UserError) as error:
            findings.append(Finding(rule, str(error)))
            return findings
        except Exception as error:
            findings.append(Finding(rule, f"{type(error).__name__}: {error}{_where(error, method)}"))
            return findings
        findings.append(Finding(rule, problem or "", fatal=False))
    return findings


def require_sound(method: type[Method], config: Any, shapes: Shapes) -> None:
    """Refuse a method that breaks a rule.

    Raises:
        UserError: one line that names the rule and what is wrong.
    """
    for finding in check_method(method, config, shapes):
        if finding.problem and finding.fatal:
            place = method.name if "." in method.__module__ else _file(method) or method.name
            raise UserError(
                f"Method '{method.name}' breaks the rule that {finding.rule}: {finding.problem}.",
                f"Check it with the same --protocol, --preset and --set: lfobench check {shlex.quote(place)}",
            )


def _configured(method: type[Method]) -> Any:
    budget = budget_fields(method.budgets.get("smoke", {}), STEPS)
    return method.Config.model_validate({**method.presets.get("released", {}), **budget})


class _Check:
    """The rules, as methods that return a remark, or raise what is wrong."""

    def __init__(self, method: type[Method], config: Any, shapes: Shapes) -> None:
        self._class, self._config, self._raw = method, config, shapes
        self._needs: DataNeeds
        self._shapes: Shapes
        self._view: View
        self._layout: StateLayout

    def rules(self) -> Iterator[tuple[str, Callable[[], str | None]]]:
        """Name and check of every rule."""
        yield "its configurations are valid", self.configurations
        yield "it asks for data that it may see", self.declaration
        yield "its state is known when it is built, and every tensor of it is a seed's own or all seeds'", self.layout
        if "label" in self._needs.offline:
            yield "its labels are one per transition, and the same every time", self.labels
        yield "only its last stage leaves its length to the protocol", self.stages
        yield "an update returns metrics [S], detached and finite", self.metrics
        yield "an action is finite, in [-1, 1] and of shape [S, N, act], and acting changes nothing", self.actions
        yield "chance comes from `randomness` and the seeds alone", self.chance
        yield "what was saved and restored goes on as what was not", self.resuming
        yield "a seed alone trains as it does beside others", self.seeds
        yield READS_BACK, self.reading_back

    def configurations(self) -> str | None:
        if faults := declaration_faults(self._class):
            raise _Broken("; ".join(faults))
        if self._config is None:
            self._config = _configured(self._class)
        return None

    def declaration(self) -> str | None:
        self._needs = self._class.needs(self._config)
        if not isinstance(self._needs, DataNeeds):
            raise _Broken(f"`needs` returns a {type(self._needs).__name__} and no DataNeeds")
        check_declaration(self._class, self._needs)
        indicator = int(self._needs.termination == "absorbing")
        self._shapes = Shapes(self._raw.observation + indicator, self._raw.action)
        self._view = random_view(self._needs, self._shapes, host(), ROWS)
        return None

    def layout(self) -> str | None:
        self._layout = state_layout(self._class, self._config, self._shapes)
        if not self._layout.tensors:
            raise _Broken("it holds no tensor")
        return None

    def labels(self) -> str | None:
        def part(actions: bool) -> Trajectories:
            generator = torch.Generator().manual_seed(1)
            lengths = torch.full((EPISODES,), STEPS)
            steps = EPISODES * STEPS
            observations = torch.randn(steps + EPISODES, self._shapes.observation, generator=generator)
            observations[-1] = torch.nan  # as where the data does not hold the last one
            return Trajectories(
                observations=observations,
                actions=torch.rand(steps, self._shapes.action, generator=generator) * 2 - 1 if actions else None,
                lengths=lengths,
                terminated=torch.arange(EPISODES) % 2 == 0,
            )

        def made(seeds: Sequence[int]) -> Tensor:
            parts = (part("action" in self._needs.offline), part("action" in self._needs.expert))
            return self._class.prepare(self._config, *parts, seeds, lambda done: None)

        first, again, alone = made(SEEDS), made(SEEDS), made((SEEDS[ALONE],))
        if tuple(first.shape) not in ((EPISODES * STEPS,), (len(SEEDS), EPISODES * STEPS)):
            raise _Broken(f"`prepare` returns {list(first.shape)} for {EPISODES * STEPS} transitions")
        if not torch.isfinite(first).all():
            raise _Broken("`prepare` returns labels that are not finite")
        if not torch.equal(first, again):
            raise _Broken("`prepare` returns other labels when it is called again")
        if not torch.equal(first[ALONE] if first.dim() == 2 else first, alone[0] if alone.dim() == 2 else alone):
            raise _Broken("`prepare` returns other labels for a seed alone")
        return None

    def stages(self) -> str | None:
        *earlier, last = self._stages(self._built(SEEDS))
        if last.steps is not None or any(stage.steps is None for stage in earlier):
            raise _Broken("stages before the last need `steps`, and the last must have None")
        return None

    def metrics(self) -> str | None:
        method = self._built(SEEDS)
        for stage in self._stages(method):
            found = self._updated(method, SEEDS, stage, 0, 1)
            for name, value in found.items():
                if not isinstance(value, torch.Tensor):
                    raise _Broken(f"'{name}' is a {type(value).__name__} and no tensor")
                if tuple(value.shape) != (len(SEEDS),):
                    raise _Broken(f"'{name}' has shape {list(value.shape)} for {len(SEEDS)} seeds")
                if value.requires_grad:
                    raise _Broken(f"'{name}' is not detached")
                if not torch.isfinite(value).all():
                    raise _Broken(f"'{name}' is not finite after one update on data of size 1")
        return None

    def actions(self) -> str | None:
        method = self._trained(SEEDS)
        before = self._state(method, SEEDS).capture()
        for rows in (1, PROBES):
            action = self._acted(method, SEEDS, rows)
            expected = (len(SEEDS), rows, self._shapes.action)
            if not isinstance(action, torch.Tensor) or tuple(action.shape) != expected:
                found = list(action.shape) if isinstance(action, torch.Tensor) else type(action).__name__
                raise _Broken(f"`act` returns {found} where {list(expected)} is due")
            if not torch.isfinite(action).all():
                raise _Broken("an action is not finite")
            if (action.abs() > 1.0).any():
                raise _Broken(f"an action has a component of {action.abs().max():.4g}")
        if differing := _differing(before, self._state(method, SEEDS).capture()):
            raise _Broken(f"acting changes '{differing}'")
        return None

    def resuming(self) -> str | None:
        self._own_state()
        straight = self._built(SEEDS)
        for stage in self._stages(straight):
            self._updated(straight, SEEDS, stage, 0, UPDATES)
            resumed = self._built(SEEDS)
            self._state(resumed, SEEDS).restore(self._state(straight, SEEDS).capture())
            saved, restored = (self._state(each, SEEDS).capture() for each in (straight, resumed))
            if differing := _differing(saved, restored):
                raise _Broken(f"'{differing}' is not what was saved: is it a copy, or made anew at every use")
            for each in (straight, resumed):
                self._updated(each, SEEDS, stage, UPDATES, 2 * UPDATES)
            self._assert_same(straight, SEEDS, resumed, SEEDS, "going on")
        return None

    def chance(self) -> str | None:
        one = self._trained(SEEDS)
        with _other_chance():
            other = self._trained(SEEDS)
        self._assert_same(one, SEEDS, other, SEEDS, "another state of torch's, NumPy's or Python's generator")
        return None

    def _own_state(self) -> None:
        """A `state` that somebody wrote must hold every tensor that updates change."""
        method = self._built(SEEDS)
        own = method.state()
        if own is None:
            return
        places = {tensor.untyped_storage().data_ptr() for tensor in own.values()}
        before = {name: tensor.clone() for name, tensor in held_tensors(method).items()}
        for stage in self._stages(method):
            self._updated(method, SEEDS, stage, 0, UPDATES)
        for name, tensor in held_tensors(method).items():
            changed = name not in before or not torch.equal(before[name], tensor)
            if changed and "@" not in name and tensor.untyped_storage().data_ptr() not in places:
                raise _Broken(f"`state` does not hold '{name}', which updates change; leave `state` out")

    def seeds(self) -> str | None:
        group, alone = self._trained(SEEDS), self._trained((SEEDS[ALONE],))
        many, one = (self._state(each, seeds).capture() for each, seeds in ((group, SEEDS), (alone, SEEDS[ALONE:][:1])))
        if differing := _differing([many[ALONE]], one):
            raise _Broken(f"'{differing}' of seed {SEEDS[ALONE]} differs when it trains alone")
        observation = _observations(len(SEEDS), PROBES, self._shapes)
        with torch.no_grad():
            beside, by_itself = group.act(observation)[ALONE], alone.act(observation[ALONE:][:1])[0]
        if not torch.equal(beside, by_itself):
            raise _Broken(f"the actions of seed {SEEDS[ALONE]} differ when it acts alone")
        return None

    def reading_back(self) -> str | None:
        method = self._built(SEEDS)
        places: set[str] = set()
        before = live_tensors(method)  # kept, so that no other tensor can take their place in memory
        with _Reads(self._class, places):
            for stage in self._stages(method):
                self._updated(method, SEEDS, stage, 0, UPDATES)
        now = live_tensors(method)
        places |= {f"'{name}' is replaced" for name in before if now[name].data_ptr() != before[name].data_ptr()}
        if places:
            return f"{', '.join(sorted(places))}; on a CUDA device its steps run one by one"
        return None

    def _built(self, seeds: Sequence[int]) -> Method:
        return self._class(self._config, self._shapes, seeds, host())

    def _stages(self, method: Method) -> Sequence[Stage]:
        stages = method.stages(self._view.sizes)
        if not stages:
            raise _Broken("there is no stage")
        return stages

    def _state(self, method: Method, seeds: Sequence[int]) -> MethodState:
        return MethodState(method, len(seeds), self._layout)

    def _updated(self, method: Method, seeds: Sequence[int], stage: Stage, first: int, last: int) -> Metrics:
        """Updates `first` to `last` of a stage; the metrics of the last one."""
        sampler, metrics = StageSampler(self._view, stage, Randomness(seeds)), {}
        for step in range(first, last):
            sampler.draws.move_to(step, sampler.draws.refill)
            offline, expert = sampler.batches(sampler.expert_rows(step))
            metrics = method.update(stage.name, offline, expert, RunningStep(sampler.draws, step % stage.period))
            sampler.draws.advance()
        return metrics

    def _trained(self, seeds: Sequence[int]) -> Method:
        method = self._built(seeds)
        for stage in self._stages(method):
            self._updated(method, seeds, stage, 0, UPDATES * max(stage.period, 1))
        return method

    def _acted(self, method: Method, seeds: Sequence[int], rows: int) -> Any:
        with torch.no_grad():
            return method.act(_observations(len(seeds), rows, self._shapes))

    def _assert_same(self, one: Method, seeds: Sequence[int], other: Method, others: Sequence[int], after: str) -> None:
        states = (self._state(one, seeds).capture(), self._state(other, others).capture())
        if differing := _differing(*states):
            raise _Broken(f"'{differing}' differs after {after}")
        if not torch.equal(self._acted(one, seeds, PROBES), self._acted(other, others, PROBES)):
            raise _Broken(f"the actions differ after {after}")


class _Reads(TorchDispatchMode):
    """Collects the lines of a method's file that turn a tensor into a number."""

    def __init__(self, method: type[Method], places: set[str]) -> None:
        super().__init__()  # type: ignore[no-untyped-call]
        self._file, self._places = _file(method), places

    def __torch_dispatch__(self, func: Any, types: Any, args: Any = (), kwargs: Any = None) -> Any:
        if func is torch.ops.aten._local_scalar_dense.default:
            frame = sys._getframe()
            while frame is not None and frame.f_code.co_filename != self._file:
                frame = frame.f_back  # type: ignore[assignment]
            if frame is not None:
                self._places.add(f"{Path(frame.f_code.co_filename).name}:{frame.f_lineno}")
        return func(*args, **(kwargs or {}))


def _file(method: type[Method]) -> str:
    try:
        return inspect.getfile(method)
    except (OSError, TypeError):
        return ""


def _where(error: Exception, method: type[Method]) -> str:
    """The innermost line of the method's own file that an error passed, as `` (mine.py:12)``."""
    trace, found = error.__traceback__, ""
    while trace is not None:
        if trace.tb_frame.f_code.co_filename == _file(method):
            found = f" ({Path(trace.tb_frame.f_code.co_filename).name}:{trace.tb_lineno})"
        trace = trace.tb_next
    return found


@contextmanager
def _other_chance() -> Iterator[None]:
    """Global generators in another state than before, which they have again afterwards."""
    states = torch.get_rng_state(), np.random.get_state(), random.getstate()
    torch.manual_seed(987_654_321)
    np.random.seed(987_654_321)
    random.seed(987_654_321)
    try:
        yield
    finally:
        torch.set_rng_state(states[0])
        np.random.set_state(states[1])
        random.setstate(states[2])


def _observations(seeds: int, rows: int, shapes: Shapes) -> Tensor:
    generator = torch.Generator().manual_seed(5)
    return torch.randn(1, rows, shapes.observation, generator=generator).repeat(seeds, 1, 1)


def _differing(one: Sequence[SeedState], other: Sequence[SeedState]) -> str | None:
    """The name of a tensor or value that is not the same, bit for bit, in two lists of states."""
    for mine, theirs in zip(one, other, strict=True):
        for name in mine.tensors.keys() | theirs.tensors.keys():
            if name not in mine.tensors or name not in theirs.tensors:
                return name
            one_of, other_of = mine.tensors[name], theirs.tensors[name]
            if one_of.shape != other_of.shape or not torch.allclose(one_of, other_of, rtol=0, atol=0, equal_nan=True):
                return name
        for name in mine.values.keys() | theirs.values.keys():
            if mine.values.get(name) != theirs.values.get(name):
                return name
    return None
