"""All that the core knows of a guard: its recorder page, its notify socket, its control socket, its drills.

The rest of the core sees three things from here: a `FlightRecorder` to note commands in, a `Beacon` to
tell the service manager, and `guarded_life` around its serving. Nothing in here knows a ledger, and
nothing in here is shared as code with the guard: `docs/wires.md` is the only thing both sides read.
"""
