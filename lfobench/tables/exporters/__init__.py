"""Formats of a table: terminal, Markdown, LaTeX, HTML, CSV and JSON."""
