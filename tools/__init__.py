"""Tools of the suites: demonstrators distilled and trained, environments and data measured. Not in the wheel."""
