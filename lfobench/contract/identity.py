"""The fields of an identity that views of a record read; a record that lacks one is not one of ours."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from typing import Annotated, Any

from pydantic import (
    BaseModel,
    ConfigDict,
    Field,
    FiniteFloat,
    Strict,
    StrictBool,
    StrictInt,
    ValidationError,
    model_validator,
)

MOST_EPISODES = 100_000
"""Of one evaluation."""

MOST_DEPTH = 30
"""Of values in values; views follow them by recursion."""

Steps = Annotated[int, Field(ge=0, le=10**12)]
_Count = Annotated[int, Strict(), Field(ge=0, le=10**12)]

LARGEST_REFERENCE = 1e100
"""Either way, of a reference return; sums and squares of returns near larger ones leave the range of float64."""


class _Fields(BaseModel):
    model_config = ConfigDict(extra="allow", frozen=True)


class _Environment(_Fields):
    id: str
    random_return: Annotated[FiniteFloat, Strict()]
    expert_return: Annotated[FiniteFloat, Strict()]
    arguments: dict[str, Any] = {}

    @model_validator(mode="after")
    def _scale(self) -> _Environment:
        if self.random_return == self.expert_return:
            raise ValueError("its two reference returns are equal, so there is no score")
        if max(abs(self.random_return), abs(self.expert_return)) > LARGEST_REFERENCE:
            raise ValueError(f"a reference return is beyond ±{LARGEST_REFERENCE:g}")
        return self


class _ActionBox(_Fields):
    low: list[float | None]
    high: list[float | None]

    @model_validator(mode="after")
    def _of_one_length(self) -> _ActionBox:
        if len(self.low) != len(self.high) or not self.low:
            raise ValueError(f"it has {len(self.low)} lower and {len(self.high)} upper bounds")
        return self


class _Recipe(_Fields):
    offline_transitions: _Count
    expert_trajectories: _Count
    demonstration_rows: _Count | None = None
    demonstrations: _Count | None = None

    @model_validator(mode="after")
    def _counted(self) -> _Recipe:
        if (self.demonstration_rows is None) == (self.demonstrations is None):
            raise ValueError("it counts its demonstrations neither or both in rows and in trajectories")
        return self


class _TrajectoryRecipe(_Fields):
    offline_trajectories: _Count
    expert: str
    expert_trajectories: _Count
    expert_transitions: _Count | None


class _Protocol(_Fields):
    name: str
    steps: _Count
    steps_assigned: StrictBool
    evaluation_every: _Count
    evaluation_episodes: Annotated[int, Strict(), Field(ge=0, le=MOST_EPISODES)]


class _Identity(_Fields):
    method: str
    method_version: StrictInt
    method_code: dict[str, str] = {}
    preset: str
    config: dict[str, Any]
    overrides: dict[str, Any]
    set: dict[str, Any]
    task: str
    environment: _Environment
    action_box: _ActionBox | None = None
    recipe: _TrajectoryRecipe | _Recipe
    expert_joins: StrictBool = True
    source: str
    protocol: _Protocol
    simulator: dict[str, str]
    seed: StrictInt


def check_identity(identity: Mapping[str, Any]) -> None:
    """Refuse an identity without the fields that tables read.

    Raises:
        ValueError: naming the first field that is missing or of the wrong kind.
    """
    check_depth(identity, "identity")
    try:
        _Identity.model_validate(identity)
    except ValidationError as error:
        raise ValueError(first_problem(error, "identity")) from error


def code_version(identity: Mapping[str, Any]) -> str:
    """A short name of a method's source files, where it does not ship with lfobench; else empty."""
    code = identity.get("method_code", {})
    return hashlib.sha256(json.dumps(code, sort_keys=True).encode()).hexdigest()[:7] if code else ""


def check_depth(value: Any, name: str) -> None:
    """Refuse JSON data of more than `MOST_DEPTH` levels.

    Raises:
        ValueError: naming the field.
    """
    level: list[Any] = [value]
    for _ in range(MOST_DEPTH):
        level = [
            inner
            for each in level
            if isinstance(each, (dict, list))
            for inner in (each.values() if isinstance(each, dict) else each)
        ]
        if not level:
            return
    raise ValueError(f"{name}: it is nested more than {MOST_DEPTH} levels deep")


def first_problem(error: ValidationError, *prefix: str) -> str:
    """The first problem as ``identity.protocol.name: field required``."""
    problem = error.errors()[0]
    place = ".".join([*prefix, *map(str, problem["loc"])])
    message = problem["msg"].removeprefix("Value error, ")
    return f"{place}: {message}" if place else message
