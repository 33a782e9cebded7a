"""How a book is written for other programs: pure printers, one transaction at a time."""
