"""Registration on import, so that ``suites.franka.registration:lfobench/…`` is a complete id."""

from __future__ import annotations

from suites.franka import register_environments

register_environments()
