"""Files that `lfobench new` copies; each is a whole one that runs."""
