"""The 24 tasks of Table 1 of DILO's paper: locomotion, adroit and kitchen, in its order.

`SUITE` mixes data as the authors' code does, `PAPER` as the paper states; locomotion is the same in both.
"""

from __future__ import annotations

from lfobench.contract.suite import Demonstrator, Level, ScriptedDemonstrator, Suite
from suites import adroit, kitchen, locomotion

_MAKERS = {
    task.environment.name: part.demonstrator
    for part in (locomotion.SUITE, adroit.SUITE, kitchen.SUITE)
    for task in part.tasks
}


def demonstrator(environment: str, level: Level) -> Demonstrator | ScriptedDemonstrator:
    """The demonstrator of the suite that has the environment."""
    maker = _MAKERS[environment]
    assert maker is not None, "all three suites can be generated"
    return maker(environment, level)


def _joined(name: str, summary: str, *parts: Suite) -> Suite:
    return Suite(
        name=name,
        summary=summary,
        tasks=tuple(task for part in parts for task in part.tasks),
        demonstrator=demonstrator,
        generation_seeds={name: seed for part in parts for name, seed in part.generation_seeds.items()},
    )


SUITE = _joined(
    "table1",
    "the 24 tasks of Table 1 of DILO's paper: locomotion, adroit, kitchen",
    *(locomotion.SUITE, adroit.SUITE, kitchen.SUITE),
)

PAPER = _joined(
    "table1-paper",
    "table1 with adroit-paper and kitchen-paper",
    *(locomotion.SUITE, adroit.PAPER, kitchen.PAPER),
)
