"""Figures of a table: what is drawn, and nothing about files."""
