"""Copies that are kept, and the log out and in: made while the ledger is at work, proven, and gone back to on a bad day."""
