"""The guard: watches a ledger core from outside, tells what happens, brings it back, keeps the proof."""

__version__ = "0.1.0"
