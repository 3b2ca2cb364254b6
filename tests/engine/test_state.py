"""The state of a method: what is captured is all that training changes, a seed's own part fits any company."""

from __future__ import annotations

from collections.abc import Sequence

import pytest
import torch
from helpers_methods import SOUND, Adapted, Momentum, Naive
from torch import Tensor

from lfobench.contract.method import Method, Shapes
from lfobench.engine.probe import random_view
from lfobench.engine.program import Program
from lfobench.engine.state import MethodState, SeedState, StateError, live_tensors, plain_values
from lfobench.randomness import Randomness

CPU = torch.device("cpu")

SHAPES = Shapes(5, 2)
SEEDS = (4, 0, 9)


def trained(
    method: type[Method], seeds: Sequence[int], first: int = 0, last: int = 6, of: Method | None = None
) -> Method:
    built = of or method(method.Config(), SHAPES, seeds, CPU)
    view = random_view(method.needs(method.Config()), SHAPES, CPU, 200)
    program = Program(built, view, built.stages(view.sizes)[-1], Randomness(seeds))
    for step in range(first, last):
        program.update(step)
    return built


def state_of(method: Method, seeds: Sequence[int]) -> MethodState:
    return MethodState.of(method, SHAPES, len(seeds))


def same(one: SeedState, other: SeedState) -> bool:
    equal = all(torch.equal(one.tensors[name], other.tensors[name]) for name in one.tensors)
    return one.tensors.keys() == other.tensors.keys() and equal and one.values == other.values


@pytest.mark.parametrize("method", SOUND)
def test_seeds_go_on_in_other_company_bit_for_bit(method: type[Method]) -> None:
    """Captured beside two others, restored alone and into another order; optimisers that never stepped included."""
    straight = state_of(trained(method, SEEDS, 0, 12), SEEDS).capture()
    saved = state_of(trained(method, SEEDS, 0, 6), SEEDS).capture()
    for places in ((1,), (2, 0), (2, 1, 0)):
        seeds = [SEEDS[place] for place in places]
        fresh = method(method.Config(), SHAPES, seeds, CPU)
        state_of(fresh, seeds).restore([saved[place] for place in places])
        trained(method, seeds, 6, 12, fresh)
        found = state_of(fresh, seeds).capture()
        assert all(same(found[index], straight[place]) for index, place in enumerate(places))


def test_what_is_captured_does_not_change_with_the_method() -> None:
    method = trained(Naive, SEEDS)
    state = state_of(method, SEEDS)
    saved = state.capture()
    before = [{name: tensor.clone() for name, tensor in each.tensors.items()} for each in saved]
    trained(Naive, SEEDS, 6, 8, method)
    assert all(
        torch.equal(each.tensors[name], kept[name]) for each, kept in zip(saved, before, strict=True) for name in kept
    )


def test_numbers_that_python_holds_are_state() -> None:
    method = trained(Adapted, SEEDS, 0, 6)
    assert plain_values(method)["updates"] == 6
    (state, *_) = state_of(method, SEEDS).capture()
    assert state.values["updates"] == 6
    assert state.values["optimizer.groups.0.lr"] < 1e-2, "the schedule's rate"


def test_a_seed_that_is_not_finite_is_found_wherever_its_numbers_are() -> None:
    for method in SOUND:
        built = trained(method, SEEDS)
        state = state_of(built, SEEDS)
        assert state.finite().tolist() == [True, True, True]
        name, tensor = max(live_tensors(built).items(), key=lambda item: item[1].numel())
        captured = state.capture()
        floats = {key: each for key, each in captured[1].tensors.items() if each.is_floating_point()}
        key = max(floats.keys() - {"mask"}, key=lambda each: floats[each].numel())
        captured[1].tensors[key].view(-1)[0] = torch.nan
        state.restore(captured)
        assert state.finite().tolist() == [True, False, True], (method, name, tensor.shape)


def test_states_that_do_not_fit_are_refused() -> None:
    state = state_of(trained(Momentum, SEEDS), SEEDS)
    saved = state.capture()
    with pytest.raises(StateError, match="2 states for 3 seeds"):
        state.restore(saved[:2])
    with pytest.raises(StateError, match="weight"):
        state.restore([SeedState({**each.tensors, "weight": torch.zeros(2, 2)}, each.values) for each in saved])
    with pytest.raises(StateError, match="weight"):
        state.restore([SeedState({}, each.values) for each in saved])
    with pytest.raises(StateError, match="no 'other'"):
        state.restore([SeedState({**each.tensors, "other": torch.zeros(2)}, each.values) for each in saved])


def test_constants_of_all_seeds_are_nobodys_own() -> None:
    """Three limits beside three seeds: a first axis of the right length says nothing."""
    captured = state_of(trained(Momentum, SEEDS), SEEDS).capture()
    assert all(each.tensors["limits.low"].shape == (3,) for each in captured)
    assert all(each.tensors["weight"].shape == (1, 5, 2) for each in captured)
    assert all(each.values["limits.high"] == 1.0 for each in captured)


def test_a_network_that_two_names_hold_is_saved_once() -> None:
    class Twice(Naive):
        def __init__(self, config: object, shapes: Shapes, seeds: Sequence[int], device: torch.device) -> None:
            super().__init__(config, shapes, seeds, device)  # type: ignore[arg-type]
            self.again = self.networks
            self.parameters: list[Tensor] = [each for network in self.networks for each in network.parameters()]

    captured = state_of(Twice(Twice.Config(), SHAPES, SEEDS, CPU), SEEDS).capture()
    assert sum(name.endswith("weight") for name in captured[0].tensors) == 2
