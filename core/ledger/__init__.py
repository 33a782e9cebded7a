"""The rules of the book: pure functions over money, accounts, commands and events.

Nothing here knows a clock, a file, a socket or a database. A command goes in with the accounts it touches,
events or a rejection come out; the journal stores the one and the web answers with the other.
"""
