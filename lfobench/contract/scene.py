"""What a top view of a task shows: plain geometry that a suite declares and pictures draw."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

from lfobench.contract.episodes import FloatArray

Role = Literal["obstacle", "goal"]
Span = tuple[float, float]


@dataclass(frozen=True)
class Disc:
    """A round thing that stays where it is.

    Attributes:
        name: the field's word for it, e.g. ``cup``.
        role: to be avoided, or to be reached.
        center: (x, y) in metres.
        radius: metres.
    """

    name: str
    role: Role
    center: tuple[float, float]
    radius: float


@dataclass(frozen=True)
class Scene:
    """A table seen from above; every length in metres.

    An environment with a scene reports where things truly are in every step's ``info``: ``effector`` ``[2]`` and, where
    there is one, ``puck`` ``[2]``.

    Attributes:
        x: the table's extent along its length; the table slopes down towards `downhill`.
        y: its extent across.
        downhill: -1 or 1, the sign of x towards which a free puck accelerates.
        workspace: (x, y) extents that the end-effector may reach.
        discs: what stands on it.
        stride: metres along x and y that an action of 1 commands.
        effector_radius: of what the end-effector carries.
        puck_radius: None where there is no puck.
        observation_at: observations ``[n, obs]`` of the end-effector at rest at positions ``[n, 2]``, for a field of
            actions; None where an observation holds more than that position.
    """

    x: Span
    y: Span
    downhill: Literal[-1, 1]
    workspace: tuple[Span, Span]
    discs: tuple[Disc, ...]
    stride: tuple[float, float]
    effector_radius: float
    puck_radius: float | None = None
    observation_at: Callable[[FloatArray], FloatArray] | None = None
