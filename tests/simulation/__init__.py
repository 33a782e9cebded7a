"""A simulated machine in which the pure middle of the guard lives through thousands of crises.

Faults + workload + checkers: the world throws stones, clients go on working, and checkers that know the
truth (which the guard does not) look at every order. Each run is a function of its seed. Not chosen: a
simulation with asyncio on a virtual loop, which would test the shell as well and be a hundred times slower.
"""
