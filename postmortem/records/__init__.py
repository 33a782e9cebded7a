"""The archive of the investigators: the only room that opens `hardcore.db`."""
