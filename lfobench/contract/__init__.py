"""Contract of methods and suites with the harness."""
