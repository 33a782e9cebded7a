"""Rules: what a bundle says about its cause, how sure that is, and the lines that say so."""
