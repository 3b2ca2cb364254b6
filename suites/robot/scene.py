"""Top views of the environments: table, workspace, cups and bowl."""

from __future__ import annotations

import numpy as np

from lfobench.contract.episodes import FloatArray
from lfobench.contract.suite import Disc, Scene
from suites.robot import constants

SAFE = ("safe-manipulation", "safe-manipulation-cross-embodiment")
PUCK = ("puck-striking", "dynamic-hitting")


def _same(position: FloatArray) -> FloatArray:
    return position.astype(np.float32)


def scene(environment_name: str) -> Scene:
    """The top view of the table, for one of the suite's four environment names.

    Raises:
        ValueError: for any other name.
    """
    if environment_name not in SAFE + PUCK:
        raise ValueError(f"environment '{environment_name}' has no scene; known are {', '.join(SAFE + PUCK)}")
    safe = environment_name in SAFE
    cups = tuple(Disc("cup", "obstacle", (float(x), float(y)), float(constants.CUP_RADIUS)) for x, y in constants.CUPS)
    bowl = Disc("bowl", "goal", (float(constants.BOWL_X), float(constants.BOWL_Y)), float(constants.BOWL_RADIUS))
    side = float(constants.TABLE_WIDTH) / 2
    return Scene(
        x=(0.0, float(constants.TABLE_LENGTH)),
        y=(-side, side),
        downhill=-1,
        workspace=(
            (float(constants.WORKSPACE_LOW_X), float(constants.WORKSPACE_HIGH_X)),
            (float(constants.WORKSPACE_LOW_Y), float(constants.WORKSPACE_HIGH_Y)),
        ),
        discs=(*cups, bowl) if safe else (),
        stride=(float(constants.CLIP_X), float(constants.CLIP_Y)),
        effector_radius=float(constants.OBJECT_DIAMETER if safe else constants.PADDLE_DIAMETER) / 2,
        puck_radius=None if safe else float(constants.PUCK_DIAMETER) / 2,
        observation_at=_same if safe else None,
    )
