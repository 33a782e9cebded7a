"""Evidence: taken from a core that hangs or has died, before anything is done to it."""
