"""A core that is ready: what it has proven, and whether it may serve.

A core that lacks what a client was told of does not serve. And where the operator wants reads only, one that could write
says first that it reads only; before that nobody is sent to it, so there is no moment in which a write is taken.
"""

from hardcore.model import observations as seen
from hardcore.model.actions import SetSafe
from hardcore.model.phases import Phase, Wanted
from hardcore.model.recorder import Witness
from hardcore.model.verdicts import Colour, Diagnosis, Grade, Testimony
from hardcore.recovery.budget import NS_PER_S
from hardcore.recovery.course import Course
from hardcore.recovery.moves import fire
from hardcore.recovery.story import Trouble
from hardcore.recovery.telling import BOOTING, mark, order
from hardcore.recovery.transitions import Trigger
from hardcore.sentinel.deaths import Death

#: What kind of proof a core tells that serves reads only.
UNPROVEN = "none"


def raised(c: Course, epoch: int, now_ns: int) -> None:
    """Take in that the core has raised the epoch."""
    c.store.raised(epoch)
    c.epoch = epoch
    if c.behind is not None:
        c.behind.fenced = True
    mark(c, "fenced", now_ns)


def ready(c: Course, fact: seen.CoreReady) -> None:
    """Take in that the core is ready."""
    if c.reader is not None:
        c.epoch = fact.epoch  # as it stands in the store: nobody has raised it
    elif fact.proof.kind == UNPROVEN:
        return  # it was started to write, and must have proven what it writes to
    else:
        c.store.reaches(fact.epoch)
        if c.phase in BOOTING and c.store.misses(fact.proof.seq):
            _misses(c, fact, fact.at_ns)
            return
        c.store.is_proven(Witness(fact.proof.seq, fact.epoch, fact.proof.hash, fact.at_ns))
    if c.phase not in BOOTING:
        return  # it is being ended: what it has proven serves nobody
    mark(c, "ready", fact.at_ns)
    if c.reader is None:
        if c.phase in {Phase.STARTING, Phase.SWITCHING}:
            raised(c, fact.epoch, fact.at_ns)
        mark(c, "verified", fact.at_ns)
        if c.story:
            c.story.proof, c.story.next_epoch = fact.proof, fact.epoch
            c.story.witness = c.challenge
    if c.wanted is Wanted.SAFE and c.reader is None:
        c.awaits, c.ask_again_ns = fact, fact.at_ns
        ask_again(c, fact.at_ns)
        return
    serve(c, fact, fact.at_ns)


def serve(c: Course, fact: seen.CoreReady, now_ns: int) -> None:
    """Let the core serve that has proven its ledger."""
    c.awaits = c.ask_again_ns = None
    if c.reader is None and c.store.misses(fact.proof.seq):
        _misses(c, fact, now_ns)  # told of while the core was waited for
        return
    fire(c, Trigger.READY, now_ns, f"proof: {fact.proof.kind}, {fact.proof.tail} events")


def ask_again(c: Course, now_ns: int) -> None:
    """Have a core that is ready say that it reads only: the operator wants nothing else, so nobody is sent to it before."""
    if c.ask_again_ns is None or now_ns < c.ask_again_ns:
        return
    c.ask_again_ns = None
    if c.awaits is not None and c.phase in BOOTING:
        c.ask_again_ns = now_ns + NS_PER_S
        order(c, SetSafe(c.life, on=True, reason=Diagnosis.OPERATOR))


def _misses(c: Course, fact: seen.CoreReady, now_ns: int) -> None:
    """A client was told of a commit that this core does not have; it was heard of after the core was told what to show."""
    told = c.store.passed_on
    assert told is not None, "held just now"
    why = f"a client was told of event {told.seq}, and the ledger ends at {fact.proof.seq}"
    death = Death(Diagnosis.STORE_CORRUPT, Grade.CERTAIN, (Testimony("gateway", Colour.RED, why),))
    c.pending = Trouble(death, now_ns)
    fire(c, Trigger.UNPROVEN, now_ns, why)
