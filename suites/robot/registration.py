"""Registration on import, so that ``suites.robot.registration:lfobench/…`` is a complete id."""

from __future__ import annotations

from suites.robot import register_environments

register_environments()
