"""Franka kitchen: gymnasium-robotics' simulation with D4RL's tasks, scores and observations."""

from __future__ import annotations

IDENTIFIER = "lfobench/FrankaKitchen-v0"
HORIZON = 280


def register_environments() -> None:
    """Make Gymnasium know ``lfobench/FrankaKitchen-v0``. A second call changes nothing."""
    from gymnasium.envs.registration import register, registry

    if IDENTIFIER not in registry:
        register(id=IDENTIFIER, entry_point="suites.franka.environment:Kitchen", max_episode_steps=HORIZON)
