"""The journal: the one place where the book is kept, and the proof that it is whole.

One writer thread owns the only connection that writes; everything it learns about the outside (a key seen
before, a higher epoch, a full disk) comes back as a value. Reading has connections of its own that can't
write. SQLite is opened only through SQLite: closing any other descriptor of its file would drop its locks.
"""
