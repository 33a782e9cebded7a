"""One diagnosis per file: a function of one look and the patience, that returns a verdict or nothing."""
