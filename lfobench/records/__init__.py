"""Records of runs on disk: written once, atomically, readable by anyone."""
