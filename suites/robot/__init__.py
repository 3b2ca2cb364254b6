"""The robot tasks of DILO's paper, simulated: an arm on a tilted air-hockey table."""

from __future__ import annotations

ENVIRONMENTS = ("SafeManipulation", "PuckStriking", "DynamicHitting")


def register_environments() -> None:
    """Make Gymnasium know ``lfobench/SafeManipulation-v0`` and its two siblings. A second call changes nothing."""
    from gymnasium.envs.registration import register, registry

    from suites.robot import constants

    horizons = (constants.SAFE_HORIZON, constants.STRIKING_HORIZON, constants.HITTING_HORIZON)
    for name, horizon in zip(ENVIRONMENTS, horizons, strict=True):
        if (identifier := f"lfobench/{name}-v0") not in registry:
            register(
                id=identifier,
                entry_point=f"suites.robot.environments:{name}",
                vector_entry_point=f"suites.robot.environments:Vector{name}",
                max_episode_steps=int(horizon),
            )
