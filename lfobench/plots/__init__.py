"""Figures of records: curves, comparisons of methods, pictures of tasks. Nothing about files."""
