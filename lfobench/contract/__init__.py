"""What methods and suites agree on with the harness; the only part of lfobench that they import."""
