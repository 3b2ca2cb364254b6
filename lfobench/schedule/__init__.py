"""Schedules: the rest of a plan, arranged for the machine and carried out; they print nothing."""
