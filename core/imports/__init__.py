"""Imports: a bank's export becomes entries of the ledger, each row exactly once.

`reading/` turns a hostile file into rows and rows into candidates, in a child process that may die of it;
`formats/` holds what is known of each bank as data. The rest of the room is the life of an import: kept,
previewed, committed, gone on with after a death. Reading knows nothing of the ledger's book, and the book
nothing of files.
"""
