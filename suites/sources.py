"""Dataset files from which tasks can be read: D4RL's by address, Minari's by identifier."""

from __future__ import annotations

from lfobench.contract.suite import DataFile

HOST = "http://rail.eecs.berkeley.edu/datasets/offline_rl"

_ADROIT = {"human": "v0_demos_clipped", "cloned": "demos-v0-bc-combined", "expert": "v0_expert_clipped"}
_KITCHEN = {
    "complete": "mini_kitchen_microwave_kettle_light_slider-v0",
    "partial": "kitchen_microwave_kettle_light_slider-v0",
    "mixed": "kitchen_microwave_kettle_bottomburner_light-v0",
}


def d4rl_locomotion(environment: str, level: str, columns: int | None = None) -> DataFile:
    """The file ``hopper-random-v2`` for ``hopper`` and ``random``."""
    address = f"{HOST}/gym_mujoco_v2/{environment}_{level}-v2.hdf5"
    return DataFile(f"{environment}-{level}-v2", (address,), columns=columns)


def d4rl_adroit(environment: str, level: str) -> DataFile:
    """The file ``pen-cloned-v0`` for ``pen`` and ``cloned``."""
    return DataFile(f"{environment}-{level}-v0", (f"{HOST}/hand_dapg/{environment}-{_ADROIT[level]}.hdf5",))


def d4rl_kitchen(level: str) -> DataFile:
    """The file ``kitchen-partial-v0`` for ``partial``."""
    return DataFile(f"kitchen-{level}-v0", (f"{HOST}/kitchen/{_KITCHEN[level]}.hdf5",))


def minari(identifier: str, columns: int | None = None) -> DataFile:
    """The dataset of an identifier, e.g. ``mujoco/hopper/medium-v0``."""
    return DataFile(identifier.replace("/", "-"), (f"minari:{identifier}",), columns=columns)
