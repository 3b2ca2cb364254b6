"""The two consoles: results go to standard output, everything else to standard error."""

from __future__ import annotations

import json
from typing import Any

from rich.console import Console

from lfobench.words import harmless

output = Console(highlight=False)
errors = Console(stderr=True, highlight=False)

INTERRUPTED = 130
"""Exit code of what the user stopped."""


def print_json(value: Any) -> None:
    """`value` as JSON on standard output, for scripts."""
    output.out(json.dumps(value, indent=2, default=str), highlight=False)


def one_line(text: str) -> str:
    """`text` without line breaks, shown as it is written: its brackets are no markup, its control codes do nothing."""
    from rich.markup import escape

    return escape(harmless(text))


def duration(seconds: float) -> str:
    """``5 s``, ``12 min``, ``3.4 h``."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"
