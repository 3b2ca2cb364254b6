"""What a run that crashed leaves instead of a record."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict, Field, model_validator

from lfobench.contract.identity import check_identity
from lfobench.contract.record import Labels


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
