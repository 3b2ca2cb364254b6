"""The names that the statistics' options take."""

from __future__ import annotations

from typing import Literal, TypeAlias

Test: TypeAlias = Literal[
    "welch", "student", "mann-whitney", "permutation", "paired-t", "wilcoxon", "paired-permutation"
]
"""Two-sided tests of scores. The first four compare training seeds, unpaired; the paired ones common start states."""

HighlightTest: TypeAlias = Literal[Test, "fisher"]
"""Tests of the highlight rule: a test of scores, or Fisher's exact test of success counts."""

Correction: TypeAlias = Literal["none", "holm", "bh"]
"""For testing many rows at once: none, Holm (family-wise error), Benjamini-Hochberg (false discovery rate)."""

Scope: TypeAlias = Literal["group", "all"]
"""Methods that compete: those without expert actions, or all of a row."""

Verdict: TypeAlias = Literal["better", "worse", "undecided"]
"""Result of a test, of the first method against the second."""

Agreement: TypeAlias = Literal["matches", "differs", "undecided", "not told apart"]
"""Result of an equivalence test of our number against a published one: the first three. A test of success counts has no
margin: its results are `differs` and `not told apart`."""
