"""What a poisonous command does to the core that runs it."""

from enum import Enum


class Harm(Enum):
    """Where the harm is done decides what it looks like from outside."""

    NONE = "none"
    CRASH = "crash"
    EXIT = "exit"
    BLOCK = "block"
    WRITE = "it crashes in the joint write"
    LATER = "it crashes a moment after its answer"
    LOG = "whoever starts from its event crashes"


#: Who does it again whenever it is run: a trial shows it.
REPRODUCED = frozenset({Harm.CRASH, Harm.EXIT, Harm.BLOCK, Harm.WRITE})
