"""Plain-text journals of other programs, on their way into the ledger."""
