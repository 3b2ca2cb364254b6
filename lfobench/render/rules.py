"""The knobs of a view by their names: what a run's score is, and what decides between methods."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast, get_args

from lfobench.contract.record import Record
from lfobench.contract.statistic import HEADLINE, SUCCESS_RATE, Statistic, parse_statistic
from lfobench.errors import UserError, unknown_name
from lfobench.render.counting import counts_successes
from lfobench.stats.highlight import Rule
from lfobench.stats.names import Correction, HighlightTest, Scope


def knobs(
    records: Sequence[Record],
    statistic: str | None = None,
    test: str | None = None,
    scope: str = "group",
    correction: str = "none",
    alpha: float = 0.05,
) -> tuple[Statistic, Rule]:
    """The score and the rule of every view of `records`: table, report, figure, comparison, from Python too.

    Where all records say how their episodes ended, runs are scored by ``success`` and compared by ``fisher``, else by
    ``last5`` and ``welch``. A `statistic` brings its own test, ``fisher`` with ``success`` and ``welch`` with the
    others, and ``fisher`` brings ``success``.

    Raises:
        UserError: an unknown name, or a level outside 0 to 1.
    """
    if statistic is not None:
        scored = parse_statistic(statistic)
    else:
        scored = SUCCESS_RATE if test == "fisher" or counts_successes(records) else HEADLINE
    compared = test if test is not None else "fisher" if scored == SUCCESS_RATE else "welch"
    for kind, name, known in (
        ("test", compared, get_args(HighlightTest)),
        ("scope", scope, get_args(Scope)),
        ("correction", correction, get_args(Correction)),
    ):
        if name not in known:
            raise unknown_name(kind, name, known)
    if not 0.0 < alpha < 1.0:
        raise UserError(f"alpha = {alpha} is not a level.", "Choose one between 0 and 1, e.g. 0.05.")
    rule = Rule(cast("HighlightTest", compared), cast("Scope", scope), cast("Correction", correction), alpha)
    return scored, rule
