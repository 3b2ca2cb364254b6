"""The record of one run: the unit of truth that every table is a view of.

A record is one JSON file. `identity` and everything measured are a function of the inputs; what may differ
between two honest runs of the same identity (time, machine, library builds) is kept apart in `provenance`.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal, TypeGuard

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

from lfobench.errors import UserError
from lfobench.score import HEADLINE, SUCCESS_RATE, Statistic, mean
from lfobench.text import short_number

MOST_EPISODES = 100_000
"""Of one evaluation."""

MOST_STEPS = 10**12
"""Of gradient steps and other counts."""

MOST_DEPTH = 30
"""Of values in values; views follow them by recursion."""

Steps = Annotated[int, Field(ge=0, le=MOST_STEPS)]
_Count = Annotated[int, Strict(), Field(ge=0, le=MOST_STEPS)]

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


SCHEMA = 1
"""Form of a record; another version's records are named and skipped."""

NUMBERS = 2
"""What equal identities stand for, in every identity under ``schema``: raised whenever sampling, boundary rules,
shared networks, the training loop or evaluation change a number. A method's own losses raise `Method.version`."""

Status = Literal["finished", "diverged"]

MOST_BYTES = 64 * 2**20
"""Of a record's file; one of ours has less than one."""

MOST_ROWS = 100_000
"""Evaluations of a run, and rows of its metrics."""

SUCCESS = "success"
"""The outcome of an episode that did what the task asks for; any other outcome is a failure by that name."""


LARGEST_SCORE = 1e15
"""Either way, of an episode; float64 does not hold the tenth, which tables print, of a larger one."""


def usable(value: object) -> TypeGuard[int | float]:
    """Whether a value is a number within ±`LARGEST_SCORE`, with which views can calculate."""
    return isinstance(value, int | float) and not isinstance(value, bool) and abs(value) <= LARGEST_SCORE


class _Model(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, ser_json_inf_nan="null")


class Evaluation(_Model):
    """Episodes run at one training step; episode k starts from the same state in every record of a task."""

    step: Steps = Field(description="Gradient steps taken before this evaluation.")
    returns: list[FiniteFloat] = Field(
        min_length=1,
        max_length=MOST_EPISODES,
        description="Undiscounted raw return of every episode, in episode order.",
    )
    lengths: list[Annotated[int, Field(ge=0, le=10**9)]] = Field(
        min_length=1, max_length=MOST_EPISODES, description="Steps of every episode."
    )
    outcomes: list[str] | None = Field(
        default=None,
        max_length=MOST_EPISODES,
        description="How every episode ended, in the environment's words, where it says so: success, or which failure.",
    )

    @model_validator(mode="after")
    def _one_of_each(self) -> Evaluation:
        if len(self.returns) != len(self.lengths):
            raise ValueError(f"it has {len(self.returns)} returns and {len(self.lengths)} lengths")
        if self.outcomes is not None and len(self.returns) != len(self.outcomes):
            raise ValueError(f"it has {len(self.returns)} returns and {len(self.outcomes)} outcomes")
        return self

    def first(self, count: int) -> Evaluation:
        """The first so many of its episodes."""
        outcomes = None if self.outcomes is None else self.outcomes[:count]
        return self.model_copy(
            update={"returns": self.returns[:count], "lengths": self.lengths[:count], "outcomes": outcomes}
        )

    @property
    def successes(self) -> int | None:
        """Episodes that succeeded; None where the environment does not say how they ended."""
        return None if self.outcomes is None else self.outcomes.count(SUCCESS)


class Metrics(_Model):
    """Training metrics, each averaged over the steps since the previous row."""

    stage: str = Field(description="The method's training stage.")
    step: Steps = Field(description="Updates of that stage done.")
    values: dict[str, float | None] = Field(description="Metric name to mean; null where not finite.")


class Labels(_Model):
    """What a table needs to place the record; descriptive, never part of the identity."""

    suite: str
    group: str = Field(description="Block of rows, e.g. random+expert.")
    row: str = Field(description="Row inside the block, e.g. hopper.")
    sees_expert_actions: bool = Field(description="Whether the method was given expert actions.")
    stated: list[str] = Field(description="Fields of the configuration that a footnote names.")
    published_starts: int | None = Field(
        default=None, ge=1, description="Fixed test starts of a publication, the first ones of this task."
    )
    uncapped: dict[str, int] = Field(
        default_factory=dict,
        description="Offline transitions and expert trajectories of the task's recipe where the protocol caps one.",
    )


class Warning(_Model):
    """Something a reader of the number should know, and what to do about it."""

    what: str
    remedy: str


class Tuning(_Model):
    """How a run's hyperparameters were chosen, and what the choice cost."""

    grid: dict[str, list[Any]] = Field(description="Field to the values tried; every combination of them was.")
    chosen: dict[str, Any] = Field(description="Field to the value that this run has.")
    criterion: str = Field(description="What was compared, e.g. mean score over 20 validation starts.")
    runs: int = Field(ge=1, description="Trainings behind the choice.")
    steps: int = Field(ge=1, description="Gradient steps of those, all together, in every stage.")


class Counts(_Model):
    """What there was of the data that a recipe asks for; a file can hold less."""

    offline_transitions: int = Field(ge=0, description="Of the offline part, before expert trajectories join it.")
    expert_trajectories: int = Field(ge=0, description="That joined the offline data, with their actions.")
    demonstration_rows: int = Field(ge=0, description="Of the expert part, of which the demonstration is made.")
    demonstrations: int | None = Field(
        default=None, ge=0, description="Trajectories that are observed, where the recipe counts them."
    )


class Record(_Model):
    """One run. See the module docstring."""

    schema_version: int = SCHEMA
    identity_hash: str
    identity: dict[str, Any] = Field(description="Every field that decides the result; see plan/cells.py.")
    labels: Labels
    status: Status
    diverged_at: Steps | None = Field(description="Step at which a non-finite value was seen, if any.")
    evaluations: list[Evaluation] = Field(max_length=MOST_ROWS)
    further: Evaluation | None = Field(
        default=None,
        description="Episodes of the trained policy from further fixed starts, the same in every record of a task.",
    )
    metrics: list[Metrics] = Field(max_length=MOST_ROWS)
    tuning: Tuning | None = Field(default=None, description="Where hyperparameters were chosen from a grid.")
    counts: Counts | None = Field(
        default=None, description="What there was of the recipe's data, where the recipe counts transitions."
    )
    warnings: list[Warning]
    provenance: dict[str, Any] = Field(description="Versions, device, wall time, data fingerprint, revision.")

    @model_validator(mode="after")
    def _complete(self) -> Record:
        check_identity(self.identity)
        check_depth(self.provenance, "provenance")
        if not isinstance(self.provenance.get("data_fingerprints", {}), dict):
            raise ValueError("its data fingerprints are not an object")
        unknown = [field for field in self.labels.stated if field not in self.identity["config"]]
        if unknown:
            raise ValueError(f"it states {', '.join(unknown)}, which its configuration lacks")
        if self.status == "finished" and not self.evaluations:
            raise ValueError("it is finished without an evaluation")
        return self

    @property
    def method(self) -> str:
        """Name of the method."""
        return str(self.identity["method"])

    @property
    def task(self) -> str:
        """Name of the task."""
        return str(self.identity["task"])

    @property
    def seed(self) -> int:
        """The run's seed."""
        return int(self.identity["seed"])

    def normalized_score(self, episode_return: float) -> float:
        """Score of one return under this record's own reference returns."""
        environment = self.identity["environment"]
        low, high = environment["random_return"], environment["expert_return"]
        return float(100.0 * (episode_return - low) / (high - low))

    def curve(self, statistic: Statistic = HEADLINE) -> list[tuple[int, float]]:
        """The score of every evaluation, as (step, score): mean normalised score, or what `success` counts.

        Raises:
            UserError: `success` of a record that does not say how its episodes ended.
        """
        return [(evaluation.step, self._mean_score([evaluation], statistic)) for evaluation in self.evaluations]

    @property
    def _episodes(self) -> int:
        return int(self.identity["protocol"]["evaluation_episodes"])

    def _mean_score(self, evaluations: Sequence[Evaluation], statistic: Statistic) -> float:
        """The mean of the evaluations' scores; of their episodes where successes are counted."""
        if statistic == SUCCESS_RATE:
            return mean([score for evaluation in evaluations for score in self._success_scores(evaluation)])
        return mean([self.normalized_score(mean(evaluation.returns)) for evaluation in evaluations])

    def _success_scores(self, evaluation: Evaluation) -> list[float]:
        """100 for every episode that succeeded and 0 for the others."""
        if evaluation.outcomes is None:
            raise UserError(
                f"{self.method} on {self.task}, seed {self.seed}, does not say how its episodes ended.",
                "Use a score of returns, e.g. --stat last5, or leave such records out with --suite or --methods.",
            )
        return [100.0 if outcome == SUCCESS else 0.0 for outcome in evaluation.outcomes]

    def counted(self, statistic: Statistic = HEADLINE) -> list[Evaluation]:
        """The evaluations that `statistic` takes the mean of, further episodes among them; none of a diverged run.

        Raises:
            UserError: the run was not evaluated at the step that the statistic names.
        """
        if self.status == "diverged":
            return []
        curve = self.curve()
        chosen = statistic.choose([step for step, _ in curve], [score for _, score in curve])
        if not chosen:
            steps = ", ".join(str(evaluation.step) for evaluation in self.evaluations)
            raise UserError(
                f"{self.method} on {self.task}, seed {self.seed}, was not evaluated at step {statistic.step}.",
                f"It was at {steps}.",
            )
        further = [self.further] if statistic == SUCCESS_RATE and self.further else []
        return [*(self.evaluations[index] for index in chosen), *further]

    def score(self, statistic: Statistic = HEADLINE) -> float:
        """The run's score under `statistic`; the headline is the mean of the last five evaluations.

        A diverged seed scores 0, the level of random actions, under every statistic: it is shown and
        counted, never dropped.

        Raises:
            UserError: as `counted` and `curve`.
        """
        evaluations = self.counted(statistic)
        return self._mean_score(evaluations, statistic) if evaluations else 0.0

    def start_scores(self, statistic: Statistic = HEADLINE) -> list[float]:
        """The run's score from each common start state ``[K]``, further ones last; their mean is `score`.

        Empty where the evaluations differ in their numbers of episodes, so that starts have no score.

        Raises:
            UserError: as `counted` and `curve`.
        """
        evaluations = self.counted(statistic)
        if not evaluations:
            fixed = len(self.evaluations[0].returns) if self.evaluations else self._episodes
            further = int(self.identity["protocol"].get("further_episodes", 0)) if statistic == SUCCESS_RATE else 0
            return [0.0] * (fixed + further)
        if statistic == SUCCESS_RATE:
            return [score for evaluation in evaluations for score in self._success_scores(evaluation)]
        if len({len(evaluation.returns) for evaluation in evaluations}) > 1:
            return []
        by_start = zip(*(evaluation.returns for evaluation in evaluations), strict=True)
        return [self.normalized_score(mean(returns)) for returns in by_start]

    def from_published_starts(self) -> Record:
        """The record as if it had been evaluated from the publication's fixed starts alone, without a final evaluation.

        Raises:
            UserError: the task has no such subset, or an evaluation fewer episodes.
        """
        count = self.labels.published_starts
        if count is None or any(len(evaluation.returns) < count for evaluation in self.evaluations):
            raise UserError(
                f"{self.method} on {self.task}, seed {self.seed}, was not evaluated from a publication's own starts.",
                "Leave out --starts, or such records with --suite or --protocol.",
            )
        protocol = {**self.identity["protocol"], "evaluation_episodes": count}
        protocol.pop("further_episodes", None)
        return self.model_copy(
            update={
                "identity": {**self.identity, "protocol": protocol},
                "evaluations": [evaluation.first(count) for evaluation in self.evaluations],
                "further": None,
            }
        )

    def bounded(self) -> Record:
        """The record as every view takes it; this one unless the score of an episode is beyond `LARGEST_SCORE`.

        A run that explodes counts as diverged from the first evaluation with such an episode on; a warning, the last
        one, says so.
        """
        evaluations = [*self.evaluations, *([self.further] if self.further else [])]
        for index, evaluation in enumerate(evaluations):
            enormous = next((each for each in evaluation.returns if not usable(self.normalized_score(each))), None)
            if enormous is not None:
                what = (
                    f"{self.method} on {self.task}, seed {self.seed} exploded: an episode at step {evaluation.step:,} "
                    f"returned {short_number(enormous)}, a score beyond ±{short_number(LARGEST_SCORE)}, so the run "
                    "counts as diverged there."
                )
                warning = Warning(what=what, remedy="Its record keeps every return.")
                return self.model_copy(
                    update={
                        "status": "diverged",
                        "diverged_at": evaluation.step,
                        "evaluations": [each for each in evaluations[:index] if each is not self.further],
                        "further": None,
                        "warnings": [*self.warnings, warning],
                    }
                )
        return self

    def measured(self) -> dict[str, Any]:
        """Everything but `provenance`: equal, bit for bit, for two runs of one identity on a CPU."""
        return self.model_dump(mode="json", exclude={"provenance"})


class Failure(BaseModel):
    """One run without a score. A later record of the same identity takes its place."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    identity_hash: str
    identity: dict[str, Any] = Field(description="As in a record.")
    labels: Labels
    error: str = Field(description="One line: what went wrong.")
    place: list[str] = Field(
        default=[], description="The innermost lines of the user's own code, e.g. mine.py:12, in update: loss = …"
    )
    traceback: list[str] = Field(description="Where, line by line.")

    @model_validator(mode="after")
    def _complete(self) -> Failure:
        check_identity(self.identity)
        return self

    @property
    def method(self) -> str:
        """Name of the method."""
        return str(self.identity["method"])

    @property
    def task(self) -> str:
        """Name of the task."""
        return str(self.identity["task"])

    @property
    def seed(self) -> int:
        """The run's seed."""
        return int(self.identity["seed"])
