"""The 24 tasks of the seed paper's Table 1: locomotion, adroit and kitchen, in its order."""

from __future__ import annotations

from lfobench.contract.suite import Demonstrator, Level, Operator, Suite
from suites.adroit import SUITE as ADROIT
from suites.kitchen import SUITE as KITCHEN
from suites.locomotion import SUITE as LOCOMOTION

PARTS = (LOCOMOTION, ADROIT, KITCHEN)
_MAKERS = {task.environment.name: part.demonstrator for part in PARTS for task in part.tasks}


def demonstrator(environment: str, level: Level) -> Demonstrator | Operator:
    """That of the suite which has the environment."""
    maker = _MAKERS[environment]
    assert maker is not None, "all three suites can be generated"
    return maker(environment, level)


SUITE = Suite(
    name="table1",
    summary="the 24 tasks of the seed paper's Table 1: locomotion, adroit, kitchen",
    tasks=tuple(task for part in PARTS for task in part.tasks),
    demonstrator=demonstrator,
    generation_seeds={name: seed for part in PARTS for name, seed in part.generation_seeds.items()},
)
