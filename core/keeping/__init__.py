"""Copies that are kept: made while the ledger is at work, proven, and gone back to on a bad day."""
