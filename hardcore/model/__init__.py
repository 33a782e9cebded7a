"""Everybody's words: facts, orders, phases and their readings. Pure, on the ground floor."""
