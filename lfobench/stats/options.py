"""The names that the statistics' options take."""

from __future__ import annotations

from typing import Literal, TypeAlias

Test: TypeAlias = Literal[
    "welch", "student", "mann-whitney", "permutation", "paired-t", "wilcoxon", "paired-permutation"
]
"""Two-sided tests of scores. The first four compare training seeds, unpaired; the paired ones common start states."""

HighlightTest: TypeAlias = Literal[Test, "fisher"]
"""What may decide the highlights of a table: a test of scores, or Fisher's exact test of success counts."""

Correction: TypeAlias = Literal["none", "holm", "bh"]
"""For testing many rows at once: none, Holm (family-wise error), Benjamini-Hochberg (false discovery rate)."""

Scope: TypeAlias = Literal["group", "all"]
"""Who is compared: the methods without expert actions, or all methods of a row."""

Verdict: TypeAlias = Literal["better", "worse", "undecided"]
"""What a test says of the first side against the second."""

Agreement: TypeAlias = Literal["matches", "differs", "undecided", "not told apart"]
"""What an equivalence test says of a result against an earlier one: the first three. A test of success counts knows no
margin, and only says that they differ or are not told apart."""
