"""Benchmarks of speed: every number is a ratio against a reference timed in the same run. Not in the wheel."""
