"""Analyses of records and of published tables: comparisons, audits, power."""
