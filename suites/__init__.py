"""The suites that the benchmark runs: one suite, one file; demonstrators beside them."""
