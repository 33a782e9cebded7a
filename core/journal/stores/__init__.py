"""What differs between the stores that a book may lie in: one room for each, the same calls in both.

Everything else of the journal is SQLAlchemy Core and knows no dialect; it goes through `core.journal.store`, which asks
the connection that it is given which of the two it is. Not chosen: a class of a store that is handed through all rooms;
a connection says by itself what it leads to.
"""
