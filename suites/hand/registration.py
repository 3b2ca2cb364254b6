"""Registration on import, so that ``suites.hand.registration:lfobench/…`` is a complete id."""

from __future__ import annotations

from suites.hand import register_environments

register_environments()
