"""gymnasium-robotics, imported when it is needed and without its notice."""

from __future__ import annotations

import contextlib
import importlib
import io
from typing import Any

from lfobench.errors import UserError


def imported(module: str, suite: str) -> Any:
    """A module of ``gymnasium_robotics.envs``, for a suite.

    Raises:
        UserError: the package, or something that it needs, is not installed.
    """
    try:
        # Its first import prints a notice about an older package, past logging and warnings.
        with contextlib.redirect_stderr(io.StringIO()):
            return importlib.import_module(f"gymnasium_robotics.envs.{module}")
    except ImportError as error:
        raise UserError(
            f"The simulator of suite '{suite}' cannot be imported: {error}.",
            "Install it: pip install 'gymnasium-robotics>=1.4.2,<2' 'mujoco>=3.3,<3.5'",
        ) from error
