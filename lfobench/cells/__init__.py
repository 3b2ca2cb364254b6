"""Names on the command line to cells and runs, each with its identity."""
