"""``python -m lfobench``."""

import sys

# Python puts the current folder first on the path; a folder named `methods` there must not shadow ours. With
# PYTHONSAFEPATH it does not, and the first entry is somebody's PYTHONPATH.
if not sys.flags.safe_path:
    del sys.path[0]

from lfobench.cli import main

main()
