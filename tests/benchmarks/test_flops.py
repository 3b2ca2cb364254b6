"""Figures worked out by hand from the networks' sizes."""

from __future__ import annotations

from fractions import Fraction

import pytest

from benchmarks import flops
from benchmarks.flops import Inventory, Pass, Product, products
from benchmarks.workloads import SHAPES
from lfobench.contract.method import Shapes

HIDDEN = (256, 256)
HOPPER = SHAPES["hopper"]
# Hopper has 11 observations and 3 actions; the figures of SMODICE and ORIL are those with the absorbing indicator.
HOPPER_ABSORBING = Shapes(12, 3)


def giga(inventory: Inventory, shapes: Shapes, batch: int, account: flops.Account) -> float:
    return flops.flops(inventory(shapes, batch, HIDDEN, account)) / 1e9


@pytest.mark.parametrize(
    ("inventory", "shapes", "account", "batch", "printed"),
    [
        (flops.dilo, HOPPER, "released", 1024, 6.15),
        (flops.dilo, HOPPER, "needed", 1024, 5.86),
        (flops.smodice, HOPPER_ABSORBING, "released", 1024, 1.82),
        (flops.smodice, HOPPER_ABSORBING, "released", 512, 0.91),
        (flops.oril, HOPPER_ABSORBING, "released", 1024, 1.83),
        (flops.oril, HOPPER_ABSORBING, "released", 512, 0.92),
        (flops.bc, HOPPER, "released", 1024, 0.42),
        (flops.bc, HOPPER, "released", 512, 0.21),
        (flops.bco_inverse_dynamics, HOPPER, "released", 1024, 0.43),
        (flops.bco_policy, HOPPER, "released", 1024, 0.42),
    ],
)
def test_printed_figures(
    inventory: Inventory, shapes: Shapes, account: flops.Account, batch: int, printed: float
) -> None:
    assert round(giga(inventory, shapes, batch, account), 2) == printed


@pytest.mark.parametrize(
    ("task", "printed"),
    [
        ("hopper", 6.15),
        ("halfcheetah", 6.35),
        ("walker2d", 6.35),
        ("pen", 7.29),
        ("door", 7.10),
        ("hammer", 7.33),
        ("kitchen", 7.76),
        ("ant", 9.41),
    ],
)
def test_dilo_per_task(task: str, printed: float) -> None:
    assert round(giga(flops.dilo, SHAPES[task], 1024, "released"), 2) == printed


def test_what_the_formulas_do_not_need() -> None:
    """Unneeded products of ORIL: gradients of the first critic in the actor's loss, and of inputs but the action."""
    extra = flops.flops(flops.oril(HOPPER, 1, HIDDEN, "released")) - flops.flops(
        flops.oril(HOPPER, 1, HIDDEN, "needed")
    )
    weight_gradients, observation_columns = 14 * 256 + 256 * 256 + 256, 11 * 256
    assert extra == weight_gradients + observation_columns


def test_shared_signals_leave_the_linear_term_its_weight_gradients() -> None:
    saved = flops.flops(flops.dilo(HOPPER, 1, HIDDEN, "needed")) - flops.flops(flops.dilo(HOPPER, 1, HIDDEN, "shared"))
    assert saved == 2 * 2 * (256 * 256 + 256)


def test_a_pass_is_these_products() -> None:
    """Forward, weight gradients and hidden signals; no gradient of the input unless columns are named."""
    plain = Pass("plain", (5, 7, 2), rows=10, heads=3, backward=1)
    assert set(products([plain])) == {
        Product("forward", 10, 5, 7, Fraction(3)),
        Product("forward", 10, 7, 2, Fraction(3)),
        Product("weight gradient", 5, 10, 7, Fraction(3)),
        Product("weight gradient", 7, 10, 2, Fraction(3)),
        Product("signal", 10, 2, 7, Fraction(3)),
    }
    rare = Pass("rare", (5, 7, 2), rows=10, forward=0, signals=1, input_columns=4, every=2)
    assert set(products([rare])) == {
        Product("signal", 10, 2, 7, Fraction(1, 2)),
        Product("signal", 10, 7, 4, Fraction(1, 2)),
    }
    assert flops.flops([rare]) == 10 * 2 * 7 + 10 * 7 * 4
