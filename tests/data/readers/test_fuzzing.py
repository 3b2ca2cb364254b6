from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from helpers_cli import PATIENCE


def test_no_mutated_file_crashes_the_process_or_is_read_in_another_shape() -> None:
    """A few hundred here; `make fuzz` tries 10,000."""
    script = Path(__file__).with_name("fuzzing.py")
    done = subprocess.run([sys.executable, str(script), "400"], capture_output=True, text=True, timeout=PATIENCE)
    assert done.returncode == 0, done.stderr[-2000:]
    assert "'refused'" in done.stdout and "'read'" in done.stdout
