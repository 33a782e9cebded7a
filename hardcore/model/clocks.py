"""Two clocks beside the one that every decision goes by.

A room of its own because the gateway reads clocks and knows nothing else of the facts: loading all of them takes it
longer than taking over the listener.
"""

import msgspec


class Clocks(msgspec.Struct, frozen=True):
    """The other two clocks at one moment: one that counts a suspended machine's sleep, and the wall's."""

    boot_ns: int
    wall_ns: int
