"""What is done for a core that has a trouble which a restart would not help.

Three voices tell of such a trouble: the judge (a red verdict that the policy does not answer with a restart), the
core (its store took a write no longer) and the proof of the whole ledger (it is not whole). They meet here, so that
one trouble is one incident whoever speaks first. And it is here that it ends: reads only are left, then nothing may
come up for a while.
"""

from hardcore.model import observations as seen
from hardcore.model.phases import SERVING
from hardcore.model.verdicts import Colour, Diagnosis, Grade, Testimony, Verdict, Wish
from hardcore.recovery import telling
from hardcore.recovery.course import Course
from hardcore.recovery.moves import fire, heed
from hardcore.recovery.policy import Word
from hardcore.recovery.safety import BY_OPERATOR, TOLD
from hardcore.recovery.story import Trouble
from hardcore.recovery.transitions import Trigger
from hardcore.sentinel.deaths import Death
from hardcore.sentinel.witnesses.store import who


def judged(c: Course, verdict: Verdict, now_ns: int, why: str) -> None:
    """Take in a red verdict that is not answered with a restart. Only its beginning is news."""
    assert verdict.diagnosis is not None, "a red verdict has a diagnosis"
    if c.verdict.colour is Colour.RED and c.verdict.diagnosis is verdict.diagnosis:
        return
    death = Death(verdict.diagnosis, verdict.grade, verdict.testimonies)
    _meet(c, death, verdict.fault_ns, verdict.blamed, now_ns, why)


def told(c: Course, fact: seen.StoreTold) -> None:
    """Take in what the core says of its store; it has switched itself already."""
    c.safety.told(fact.fault, fact.at_ns)
    diagnosis = TOLD.get(fact.fault)
    if diagnosis is not None:
        said = Testimony("core", Colour.RED, f"the core's store took a write no longer: {fact.fault}")
        _meet(c, Death(diagnosis, Grade.CERTAIN, (said,)), fact.at_ns, (), fact.at_ns, said.why)
    settle(c, fact.at_ns)


def audited(c: Course, fact: seen.LedgerAudited) -> None:
    """Take in what the serving core said of the whole ledger."""
    c.actions += c.audit.take(fact, c.story)
    if fact.ok:
        c.troubles.lasting = False  # another core, and perhaps another copy of the ledger
        settle(c, fact.at_ns)
        return
    if c.safety.reason is Diagnosis.STORE_CORRUPT and c.story is None:
        return  # it reads only because of that, and a person has been told: its word joins what was told
    said = Testimony("proof", Colour.RED, f"the ledger is not whole: {fact.fault}")
    death = Death(Diagnosis.STORE_CORRUPT, Grade.CERTAIN, (said,))
    _meet(c, death, fact.at_ns, (), fact.at_ns, said.why)
    if c.story is not None:
        c.story.audit = fact
    settle(c, fact.at_ns)


def looked(c: Course, fact: seen.StoreLooked) -> None:
    """Take in who holds the store's lock, whichever core it was asked for."""
    strangers = [holder for holder in fact.holders if not holder.ours]
    c.holder = None
    if strangers:
        c.holder = Testimony("store", Colour.RED, f"{who(strangers[0])} holds the store's write lock")
        if c.story is not None and any(death.diagnosis is Diagnosis.DB_LOCKED for death in c.story.deaths):
            c.story.add_evidence((c.holder,))
    if fact.life != c.life or c.phase not in SERVING:
        return
    c.bench.hear(fact)
    c.curiosity.answered(Wish.STORE)
    heed(c, c.safety.looked(held=bool(strangers), now_ns=fact.at_ns), fact.at_ns)


def switched(c: Course, fact: seen.SafeSwitched) -> None:
    """Take in the core's answer to an order to read only, or to write again.

    One to an order of before it served may come when that is wanted no more: what it obeyed is taken back.
    """
    if fact.on and fact.done and c.safety.asked is None and c.safety.found(BY_OPERATOR, fact.at_ns):
        heed(c, c.safety.try_to_write(fact.at_ns), fact.at_ns, asked=True)
    c.safety.switched(fact)
    if fact.on and fact.done and c.safety.reason is BY_OPERATOR:
        # What it said of its store was of its own writes: it makes none now, and would never take that back.
        c.bench.hear(seen.StoreTold(fact.at_ns, fact.life, seen.StoreFault.OK))
    settle(c, fact.at_ns)


def probed(c: Course, fact: seen.Probed) -> None:
    """Take in what the core answered when it was asked for its health: it reads only, and nobody had told us, or not."""
    if fact.writes is None or fact.asked_ns <= c.safety.since_ns:
        return  # asked before the switch that we know of: the answer is older than what we know
    if fact.writes:
        heed(c, c.safety.writes(fact.at_ns), fact.at_ns)
    elif fact.safe is BY_OPERATOR:
        if c.safety.found(fact.safe, fact.at_ns) and not c.safety.held:
            heed(
                c, c.safety.try_to_write(fact.at_ns), fact.at_ns
            )  # an earlier guard's word: it is wanted no more
    elif fact.safe is not None and c.safety.found(fact.safe, fact.at_ns):
        said = Testimony("core", Colour.RED, f"the core was found to serve reads only: {fact.safe}")
        _meet(c, Death(fact.safe, Grade.CERTAIN, (said,)), fact.at_ns, (), fact.at_ns, said.why)
    settle(c, fact.at_ns)


def surveyed(c: Course, fact: seen.Surveyed) -> None:
    """Take in what was looked at beside the watch."""
    if fact.disk is not None:
        c.safety.disk = fact.disk


def lacking(c: Course, fact: seen.GatewayWitnessed) -> None:
    """Take in that a client was told of a commit that the core which serves did not find when it began."""
    c.store.told(fact.witness)
    proven = c.store.proven
    known = c.safety.locked and c.story is None  # a person has been told that it is damaged
    if c.phase in SERVING and c.reader is None and proven is not None and not known:
        why = (
            f"a client was told of event {fact.witness.seq}, and the ledger ended at {proven.seq} after that"
        )
        death = Death(Diagnosis.STORE_CORRUPT, Grade.CERTAIN, (Testimony("gateway", Colour.RED, why),))
        _meet(c, death, fact.at_ns, (), fact.at_ns, why)
        settle(c, fact.at_ns)


def resumed(c: Course, now_ns: int) -> None:
    """The operator says of a serving core: try again, whatever was wrong."""
    c.troubles.lasting = False
    heed(c, c.safety.try_to_write(now_ns), now_ns, asked=True)
    settle(c, now_ns)


def ring(c: Course, now_ns: int) -> None:
    """Do what the time has come for: an order again, a try to write, the end of a trouble."""
    if c.phase not in SERVING:
        return
    heed(c, c.safety.ring(now_ns, quiet=c.verdict.colour is not Colour.RED), now_ns)
    settle(c, now_ns)
    if c.troubles.due_ns is not None and now_ns >= c.troubles.due_ns:
        ended = ", ".join(c.troubles.known)
        c.troubles.clear()
        fire(c, Trigger.EASED, now_ns, f"{ended}: nothing more has come up")


def next_ns(c: Course) -> int | None:
    """Return when `ring` wants to be called, or None while nothing waits for its time."""
    due = [at_ns for at_ns in (c.safety.due_ns, c.troubles.due_ns) if at_ns is not None]
    return min(due) if due and c.phase in SERVING else None


def settle(c: Course, now_ns: int) -> None:
    """Note whether anything is still wrong at this moment."""
    if c.safety.trouble is not None and c.story is not None:
        c.story.safe = True
    person = telling.left_to_a_person(c)
    if person is not None and c.troubles.on:
        fire(c, Trigger.EASED, now_ns, f"{person}: a person has to say what now")
    if c.phase in SERVING:
        quiet = c.verdict.colour is not Colour.RED and not c.safety.troubled
        c.troubles.look(now_ns, quiet=quiet)


def _meet(c: Course, death: Death, fault_ns: int, blamed: tuple[str, ...], now_ns: int, why: str) -> None:
    if c.policy.words(death.diagnosis) == {Word.NONE}:
        return
    c.pending = Trouble(death, fault_ns, blamed=blamed)
    fire(c, Trigger.TROUBLED, now_ns, f"{death.diagnosis}: {why}")
