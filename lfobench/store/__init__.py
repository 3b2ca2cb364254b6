"""Records on disk: written once, atomically, readable by anyone."""
