"""Data files that others made, as a suite or a user names them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from lfobench.contract.environment import Environment
from lfobench.contract.recipe import Recipe

GENERATED = "generated"
"""The source that is made by the suite; any other one is read from files."""


@dataclass(frozen=True)
class DataFile:
    """A file, or the folder of a dataset.

    Attributes:
        name: what its source calls it, e.g. ``hopper-random-v2``.
        addresses: where it is to be had, the first that answers.
        path: where it lies; None of a published one that is not here.
        sha256: of its bytes, where it is here.
        columns: how many of an observation's columns are read, from the first on; None reads all. D4RL's ant has 84
            that are zero throughout.
        keys: what an observation is made of, in this order, where the file has a dictionary of them; None takes those
            that are usual in its layout.
    """

    name: str
    addresses: tuple[str, ...] = ()
    path: str | None = None
    sha256: str | None = None
    columns: int | None = None
    keys: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        if not self.addresses and self.path is None:
            raise ValueError(f"data file '{self.name}' has neither an address nor a path")
        if self.columns is not None and self.columns < 1:
            raise ValueError(f"data file '{self.name}' has columns = {self.columns}; it must be at least 1")
        if self.keys is not None:
            check_keys(self.keys)


def check_keys(keys: object) -> None:
    """Refuse what are no keys of an observation.

    Raises:
        ValueError: saying what they should be.
    """
    if not isinstance(keys, tuple) or not all(isinstance(key, str) and key and key.isprintable() for key in keys):
        raise ValueError(f"keys are {keys!a}; they should be a tuple of names")
    if not keys or len(set(keys)) < len(keys):
        raise ValueError(f"keys are {keys!a}; at least one is named, and none twice")


def own_file(path: str | Path, keys: tuple[str, ...] | None = None) -> DataFile:
    """A user's file, called by its own name; ``~`` is the home folder, and `keys` are as `DataFile` has them.

    Raises:
        ValueError: the path is relative, and would be another file in another working folder; or it cannot
            be written into a record.
    """
    place = Path(path).expanduser()
    if not str(place).isprintable():
        raise ValueError(f"{str(place)!a} cannot be written down; name a link to it that can")
    if not place.is_absolute():
        raise ValueError(f"{path} is relative; write Path(__file__).parent / {str(path)!r} for one beside the suite")
    return DataFile(place.stem or str(place), path=str(place), keys=keys)


@dataclass(frozen=True)
class Files:
    """What a task is read from instead of being generated.

    Attributes:
        offline: the poor part; None generates it.
        expert: the expert part; None generates it.
        environment: where policies are evaluated that learn from it; None keeps the task's.
        recipe: how it is mixed; None keeps the task's.
        group: the block of rows, where the task's own is named by the stand-ins of these data; None keeps the task's.
        returns: whether the rewards in the files add up to what the environment returns; D4RL's kitchen rewards every
            step after a completion. No method sees them; where they do not, no score of the data is told.
    """

    offline: DataFile | None = None
    expert: DataFile | None = None
    environment: Environment | None = None
    recipe: Recipe | None = None
    group: str | None = None
    returns: bool = True

    def __post_init__(self) -> None:
        if self.offline is None and self.expert is None:
            raise ValueError("neither the offline nor the expert part is a file")
