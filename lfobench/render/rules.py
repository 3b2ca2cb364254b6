"""The knobs of a view by their names: what decides its highlights."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast, get_args

from lfobench.contract.record import Record
from lfobench.errors import UserError, unknown_name
from lfobench.render.counting import counts_successes
from lfobench.stats.highlight import Rule
from lfobench.stats.names import Correction, HighlightTest, Scope, Test


def make_rule(test: str = "welch", scope: str = "group", correction: str = "none", alpha: float = 0.05) -> Rule:
    """The four knobs as a value, for views of scores.

    Raises:
        UserError: an unknown name, a level outside 0 to 1, or `fisher`, which compares success counts.
    """
    if test == "fisher":
        raise UserError(
            "'fisher' compares success counts, which only the table shows.",
            f"Choose a test of scores: {', '.join(get_args(Test))}.",
        )
    return _rule(test, get_args(Test), scope, correction, alpha)


def table_rule(
    records: Sequence[Record],
    test: str | None = None,
    scope: str = "group",
    correction: str = "none",
    alpha: float = 0.05,
) -> Rule:
    """The four knobs of a table of `records`: without a `test`, fisher where all of them count successes, else welch.

    Raises:
        UserError: an unknown name, or a level outside 0 to 1.
    """
    default = "fisher" if counts_successes(records) else "welch"
    return _rule(default if test is None else test, get_args(HighlightTest), scope, correction, alpha)


def _rule(test: str, tests: Sequence[str], scope: str, correction: str, alpha: float) -> Rule:
    for kind, name, known in (
        ("test", test, tests),
        ("scope", scope, get_args(Scope)),
        ("correction", correction, get_args(Correction)),
    ):
        if name not in known:
            raise unknown_name(kind, name, known)
    if not 0.0 < alpha < 1.0:
        raise UserError(f"alpha = {alpha} is not a level.", "Choose one between 0 and 1, e.g. 0.05.")
    return Rule(cast("HighlightTest", test), cast("Scope", scope), cast("Correction", correction), alpha)
