"""The ledger core: the guarded process that owns a household's book.

It can run alone on loopback, or under a guard that it knows only by the wires of `docs/wires.md`. The pure
rules live in `ledger/`, the store in `journal/`, HTTP in `web/`, and everything that speaks to a guard in
`guarded/`. It imports nothing of the guard and nothing of the investigators: each of the three can die alone.
"""
