"""Names on the command line to the list of runs, each with its identity."""
