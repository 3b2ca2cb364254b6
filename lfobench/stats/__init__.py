"""Aggregates and tests: pure functions of numbers, each with its reference."""
