"""Random faults on real processes, several in one run, and an audit of every invariant when it is quiet again."""
