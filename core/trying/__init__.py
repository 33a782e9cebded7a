"""Throw-away cores: what a command, a row or an event does to a core is tried on a copy of the ledger.

A small process that loads everything and does nothing itself (`court.py`) makes the copy and forks one core after another
(`life.py`, the same code as the one that serves); it gives them one case after another and watches from outside
(`watch.py`). Whatever a case does, it does to the copy, which is removed at the end.
"""
