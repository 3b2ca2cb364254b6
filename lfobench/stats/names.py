"""The names that the statistics' options take."""

from __future__ import annotations

from typing import Literal, TypeAlias

Test: TypeAlias = Literal[
    "welch", "student", "mann-whitney", "permutation", "paired-t", "wilcoxon", "paired-permutation"
]
"""Two-sided tests. The first four compare training seeds, unpaired; the paired ones compare common start states."""

Correction: TypeAlias = Literal["none", "holm", "bh"]
"""For testing many rows at once: none, Holm (family-wise error), Benjamini-Hochberg (false discovery rate)."""

Scope: TypeAlias = Literal["group", "all"]
"""Who is compared: the methods without expert actions, or all methods of a row."""

Verdict: TypeAlias = Literal["better", "worse", "undecided"]
"""What a test says of the first side against the second."""

Agreement: TypeAlias = Literal["matches", "differs", "undecided"]
"""What an equivalence test says of a result against an earlier one."""
