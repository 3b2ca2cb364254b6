"""Registers the environment when it is imported, so ``suites.franka.registration:lfobench/…`` is a complete id."""

from __future__ import annotations

from suites.franka import register_environments

register_environments()
