"""Claims of speed, measured: every number is a ratio against a reference timed in the same run."""
