"""Paper and ink: every text a person reads and the printing of pages; knows none of the islands."""
