"""How a task's data is put together out of parts of different quality."""

from __future__ import annotations

from dataclasses import MISSING, dataclass, fields, replace
from typing import Any

from lfobench.words import counted

Level = str
"""How well a part of the data was made, in the suite's own words: ``random``, ``medium``, ``expert``, …"""


@dataclass(frozen=True)
class Recipe:
    """What makes the offline data, and what of the expert is observed (methods.md 2.3 and 2.4).

    Attributes:
        offline: level of who made the poor part of the offline data.
        offline_transitions: raw transitions of that part; None where it is counted in trajectories.
        expert: level of who made the expert part.
        expert_trajectories: K, the first trajectories of the expert part, which join the offline data with their
            actions; all that there are, if those are fewer.
        demonstration_rows: where given, under ``released`` boundaries the first so many rows of the expert part are
            observed, wherever its trajectories end, as by the published readers, and under ``exact`` ones its first
            trajectory. Where trajectories have another length than this, methods see different demonstrations.
        demonstrations: otherwise, how many trajectories are observed, the first ones and the same by every method.
        offline_trajectories: of the poor part, in the place of its transitions.
        expert_transitions: where given, only so many (s, s', s'') of the demonstrations are observed, drawn uniformly
            and in random order.
        expert_actions: whether demonstrations have actions at all; a tracked hand has none.
        equal_transitions: cut the poor part to as many transitions as the demonstrations have.
        standardize: shift and scale observations by the offline data's mean and standard deviation for every method,
            whatever it declares: in metres, a step is a hundredth of what networks are used to.
        exact: whether every boundary is exact, whatever a method declares: the quirks of the published readers belong
            to other data.
    """

    offline: Level
    offline_transitions: int | None
    expert: Level
    expert_trajectories: int
    demonstration_rows: int | None = None
    demonstrations: int = 1
    offline_trajectories: int | None = None
    expert_transitions: int | None = None
    expert_actions: bool = True
    equal_transitions: bool = False
    standardize: bool = False
    exact: bool = False

    @classmethod
    def recorded(
        cls, offline: Level, offline_trajectories: int, expert: Level, demonstrations: int, **others: Any
    ) -> Recipe:
        """Recorded trajectories, of which the expert's are observed and join nothing (methods.md 7).

        Args:
            offline: level of who recorded the offline data.
            offline_trajectories: recorded for it.
            expert: level of who recorded the demonstrations.
            demonstrations: recorded; all of them are observed.
            others: further fields of a recipe.
        """
        return cls(
            offline,
            None,
            expert,
            0,
            demonstrations=demonstrations,
            offline_trajectories=offline_trajectories,
            exact=True,
            **others,
        )

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            least = int(name != "expert_trajectories")
            if type(value) is int and value < least:
                raise ValueError(f"a recipe's {name} is {value}; it must be at least {least}")
        if (self.offline_transitions is None) == (self.offline_trajectories is None):
            raise ValueError("a recipe counts its offline part either in transitions or in trajectories")
        if self.demonstration_rows is not None and (self.exact or self.demonstrations != 1):
            raise ValueError("a recipe counts demonstrations either in rows, as published, or in trajectories")
        if self.expert_transitions is not None and not self.exact:
            raise ValueError("a recipe that samples expert_transitions must be exact")
        if self.expert_trajectories and not self.expert_actions:
            raise ValueError("a recipe's expert_trajectories cannot join the offline data without actions")

    @property
    def observed(self) -> int:
        """Trajectories that are observed, where no rows are counted."""
        return 1 if self.demonstration_rows is not None else self.demonstrations

    @property
    def identity(self) -> dict[str, Any]:
        """As plain JSON data, by which records are found: what it once was for a recipe, it must stay.

        A recipe that counts its offline part in trajectories has always called its demonstrations
        `expert_trajectories`, and has spelled more of its fields; any other field is there where it is not as usual.
        """
        usual = {each.name: each.default for each in fields(self) if each.default is not MISSING}
        spelled = {"offline", "expert", "expert_trajectories"}
        values = dict(vars(self))
        if self.offline_trajectories is None:
            counted_in = "demonstrations" if self.demonstration_rows is None else "demonstration_rows"
            spelled |= {"offline_transitions", counted_in}
        else:
            usual |= {"offline_transitions": None, "expert_trajectories_joined": 0, "exact": True}
            values["expert_trajectories_joined"] = self.expert_trajectories
            values["expert_trajectories"] = values.pop("demonstrations")
            spelled |= {"offline_trajectories", "expert_transitions", "expert_actions"}
            spelled |= {"equal_transitions", "standardize"}
        return {name: value for name, value in values.items() if name in spelled or value != usual[name]}

    def capped(self, transitions: int | None, trajectories: int | None) -> Recipe:
        """The recipe with at most so many transitions and so many expert trajectories that join them; None is no cap.

        What is counted in trajectories to begin with is little, and stays as it is.
        """
        if self.offline_transitions is None:
            return self
        return replace(
            self,
            offline_transitions=min(self.offline_transitions, transitions or self.offline_transitions),
            expert_trajectories=min(self.expert_trajectories, trajectories or self.expert_trajectories),
        )

    def most_rows(self, horizon: int) -> tuple[int, int]:
        """Offline and expert rows to train on, if every trajectory runs to the horizon."""
        observed = self.observed * horizon
        offline = self.offline_transitions or (self.offline_trajectories or 0) * horizon
        if self.equal_transitions:
            offline = observed
        return (
            offline + self.expert_trajectories * horizon,
            self.demonstration_rows or self.expert_transitions or observed,
        )

    @property
    def words(self) -> tuple[str, str]:
        """The offline part, and what is taken of the expert."""
        many = f"{self.expert} trajectories"
        offline = (
            f"{self.offline_trajectories} {self.offline} trajectories"
            if self.offline_transitions is None
            else f"{self.offline_transitions:,} {self.offline} transitions"
        )
        joined = counted(self.expert_trajectories, f"{self.expert} trajectory", many)
        if self.demonstration_rows is not None:
            return offline, joined
        sample = "" if self.expert_transitions is None else f"{self.expert_transitions} transitions of "
        if not self.expert_trajectories:
            return offline, sample + counted(self.demonstrations, f"{self.expert} trajectory", many)
        return offline, f"{joined}, {sample}{self.demonstrations} observed"

    @property
    def sentence(self) -> str:
        """Both parts in words, and what is cut."""
        cut = ", the former cut to as many transitions as the latter" if self.equal_transitions else ""
        return f"{' + '.join(self.words)}{cut}"
