"""Adroit's hand from gymnasium-robotics, adapted to the returns of D4RL's ``-v0`` environments.

D4RL: Fu et al., 2020, arXiv:2004.07219. The tasks and their rewards: Rajeswaran et al., 2018, arXiv:1709.10087.
"""

from __future__ import annotations

HORIZONS = {"pen": 100, "door": 200, "hammer": 200}
"""Steps of an episode, per environment."""

LASTING = {"pen": 20, "door": 25, "hammer": 25}
"""An episode succeeds by D4RL's own count, ``evaluate_success``, if more of its steps than these are successful."""


def identifier(environment: str) -> str:
    """The `Environment.id` of an environment's short name, e.g. ``pen``."""
    return f"suites.hand.registration:{_name(environment)}"


def register_environments() -> None:
    """Make Gymnasium know ``lfobench/AdroitHandPen-v0`` and its two siblings. A second call changes nothing."""
    from gymnasium.envs.registration import register, registry

    for environment, horizon in HORIZONS.items():
        if (name := _name(environment)) not in registry:
            register(id=name, entry_point=f"suites.hand.environments:{environment}", max_episode_steps=horizon)


def _name(environment: str) -> str:
    return f"lfobench/AdroitHand{environment.capitalize()}-v0"
