"""How a task's data is put together out of parts of different quality."""

from __future__ import annotations

from dataclasses import dataclass

from lfobench.words import counted

Level = str
"""How well a part of the data was made, in the suite's own words: ``random``, ``medium``, ``expert``, …"""


@dataclass(frozen=True)
class Recipe:
    """How a task's data is mixed (methods.md 2.3 and 2.4).

    Attributes:
        offline: level of the policy behind the poor part of the offline data.
        offline_transitions: raw transitions of that part.
        expert: level of the policy behind the expert part.
        expert_trajectories: K, trajectories of the expert part mixed into the offline data, with actions.
        demonstration_rows: rows of the expert part that form the one expert observation trajectory.
    """

    offline: Level
    offline_transitions: int
    expert: Level
    expert_trajectories: int
    demonstration_rows: int

    def __post_init__(self) -> None:
        for name, least in (("offline_transitions", 1), ("expert_trajectories", 0), ("demonstration_rows", 1)):
            if getattr(self, name) < least:
                raise ValueError(f"a recipe's {name} is {getattr(self, name)}; it must be at least {least}")

    @property
    def words(self) -> tuple[str, str]:
        """The offline part, and what of the expert joins it."""
        offline = f"{self.offline_transitions:,} {self.offline} transitions"
        one = f"{self.expert} trajectory"
        return offline, counted(self.expert_trajectories, one, f"{self.expert} trajectories")


@dataclass(frozen=True)
class TrajectoryRecipe:
    """Data counted in recorded trajectories; none of the expert part joins the offline part (methods.md 7).

    Every boundary is exact: the quirks of the D4RL readers belong to other data.

    Attributes:
        offline: level of the operator behind the offline data.
        offline_trajectories: recorded for that part.
        expert: level of the operator behind the demonstrations.
        expert_trajectories: recorded; all of them are observed.
        expert_transitions: where given, only this many (s, s', s'') of them are, drawn uniformly and in random order.
        expert_actions: whether the demonstrations have actions at all; a tracked hand has none.
        equal_transitions: cut the offline part to as many transitions as the recorded expert part has.
        standardize: shift and scale observations by the offline part's mean and standard deviation for every method,
            whatever it declares: in metres, a step is a hundredth of what networks are used to.
    """

    offline: Level
    offline_trajectories: int
    expert: Level
    expert_trajectories: int
    expert_transitions: int | None = None
    expert_actions: bool = True
    equal_transitions: bool = False
    standardize: bool = False

    def __post_init__(self) -> None:
        for name in ("offline_trajectories", "expert_trajectories", "expert_transitions"):
            value = getattr(self, name)
            if value is not None and value < 1:
                raise ValueError(f"a recipe's {name} is {value}; it must be at least 1")

    @property
    def words(self) -> tuple[str, str]:
        """The offline part, and what of the expert is observed."""
        sample = "" if self.expert_transitions is None else f"{self.expert_transitions} transitions of "
        return (
            f"{self.offline_trajectories} {self.offline} trajectories",
            f"{sample}{self.expert_trajectories} {self.expert} trajectories",
        )
