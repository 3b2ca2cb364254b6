"""The report: one HTML page with verdict, table, curves, provenance and commands."""
