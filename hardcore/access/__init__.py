"""Who may come in: people and their passwords, tokens of programs, sessions, and under what the door stands open."""
