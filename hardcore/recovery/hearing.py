"""Joins the court to the course: which death is whose, what a conviction changes, and when a start waits for the log.

What the court orders goes out through here, because a conviction means something outside it as well: the death it
explains leaves the restart budget, and a guard that had given up over such deaths tries again. A core that dies before
it serves may have died of an event of the log; so the log is tried at once, once in an incident, and the next start
waits for that, as long as a start may take. That wait is no phase and no question of the table: it is the length of
the pause that BACKOFF has anyway after a core that proved nothing (a spare that fails has none), so that a stop, a person's
word and the reading of the phase need no second rule.
"""

from msgspec import structs

from hardcore.model import trials
from hardcore.model.phases import SERVING, Phase
from hardcore.model.recorder import Page
from hardcore.model.trials import CourtMemory, SetAside, TrialAction
from hardcore.model.verdicts import Colour, Diagnosis, Testimony
from hardcore.recovery import telling, trial
from hardcore.recovery.budget import NS_PER_MS, NS_PER_S
from hardcore.recovery.course import FALLS_MAX, NEAR_DEATHS, Course, Fall
from hardcore.recovery.court import DRILL_KIND
from hardcore.recovery.policy import Word
from hardcore.recovery.register import Death
from hardcore.recovery.story import Trouble
from hardcore.recovery.suspicion import Growth
from hardcore.recovery.telling import BOOTING, order

#: A death so soon after a suspect was cleared, or after a command was finished, may have to do with it.
NEAR_NS = 2 * NS_PER_S
#: Ends of a core that has not served yet for which an event of the log may be to blame.
_OF_THE_LOG = trial.FROM_INSIDE | {Diagnosis.STARTUP_FAILED}


def inherit(c: Course, memory: CourtMemory | None, names: tuple[str, ...], now_ns: int) -> None:
    """Go on where an earlier guard's court was. `names`: whom it suspected, as far as its traces say."""
    if memory is not None or names:
        c.court.inherit(memory or CourtMemory(), names, now_ns)
        _keep(c)


def fell(c: Course, trouble: Trouble, now_ns: int, *, planned: bool) -> None:
    """A core has died or is being ended, and its incident is open: note what was said of it, and accuse."""
    assert c.story is not None, "an incident is opened before anybody is accused"
    lately = c.court.acquitted_ns is not None and now_ns - c.court.acquitted_ns <= NEAR_NS
    early = not planned and (c.phase is Phase.PROBATION or (lately and c.phase in SERVING))
    fall = Fall(c.life, now_ns, booting=not planned and c.phase in BOOTING, early=early)
    c.falls = (*c.falls, fall)[-FALLS_MAX:]
    blame = telling.suspected_of(c)
    read(c, trouble.page, blame, c.life, now_ns, c.growth)
    ended = c.there and c.reader is None and blame in _OF_THE_LOG
    if fall.booting and ended and not _tried_in(c, c.story.id):
        death = Death(now_ns, c.story.id, c.blame)
        give(c, c.court.suspect_log(death, 0, now_ns), now_ns)


def read(
    c: Course,
    page: Page | None,
    blame: Diagnosis | None,
    life: int,
    now_ns: int,
    growth: Growth | None = None,
) -> None:
    """Accuse who was at work, by the page of a core that died of `blame`; None: nobody knows of what.

    A page of one death may be read twice, while its core is stopped and when it is gone.
    """
    if page is None or blame is None or c.story is None:
        return
    fall = _fall(c, life, now_ns)
    death = Death(fall.at_ns, c.story.id, blame)
    touched = trial.touched(blame, page.in_flight, growth)
    if touched:
        at_work = {note.key_hash for note in touched}
        fresh = fall.early and not at_work & c.court.register.by_key.keys()
        company = trial.company(touched, page.in_flight)[: c.policy.trial_limit]
        c.court.register.accuse(death, touched, company)
        if fresh:
            c.court.doubt = death
    elif blame in trial.FROM_INSIDE and not fall.judged:
        c.falls = tuple(structs.replace(f, judged=f.judged or f is fall) for f in c.falls)
        _mark_near(c, page, fall.at_ns)
        if fall.early:
            given = c.court.clear(now_ns)
            if not _tried_in(c, c.story.id):
                given += c.court.suspect_log(death, c.court.register.settled_seq, now_ns)
            give(c, given, now_ns)
    _keep(c)


def serves(c: Course, now_ns: int) -> None:
    """A core serves from now on: cases may be filed, and tried."""
    c.court.served_ns = now_ns


def settle(c: Course) -> None:
    """A core has outlived its probation: what the ledger held by now kills nobody later on."""
    witness = c.store.witness
    register = c.court.register
    if witness is not None and witness.seq != register.settled_seq:
        register.settled_seq, register.changed = witness.seq, True


def heard(c: Course, fact: trials.TrialObservation) -> None:
    """Take in a fact about suspects."""
    court, now_ns = c.court, fact.at_ns
    match fact:
        case trials.CaseFiled():
            give(c, court.filed(fact.name, fact.source, fact.digest, now_ns), now_ns)
        case trials.SuspectsSettled():
            court.register.settle(fact.names)
        case trials.Tried():
            give(c, court.tried(fact, c.given.new_id), now_ns)
        case trials.CourtAtWork():
            court.at_work(now_ns)
        case trials.TrialsOver():
            give(c, court.over(fact.fault, now_ns, c.given.new_id), now_ns)
        case trials.RuleRemoved():
            court.register.release(fact.rule)


def sit(c: Course, now_ns: int) -> None:
    """Do what the court's time has come for; called after everything that was heard."""
    if c.phase not in SERVING:
        c.court.served_ns = None
    give(c, c.court.convene(now_ns, c.given.new_id), now_ns)
    if c.pause_until_ns is not None and not c.court.tries_log:
        if c.phase is Phase.BACKOFF:
            c.deadline.due_ns = max(now_ns, c.pause_until_ns)  # nothing is waited for any more
        c.pause_until_ns = None
    _keep(c)


def pause_ns(c: Course, pause_ns: int, now_ns: int) -> int:
    """Return how long the next start waits, which would wait for `pause_ns` by itself."""
    c.pause_until_ns = None
    if not (c.tries and c.court.tries_log and c.falls and c.falls[-1].booting):
        return pause_ns
    c.pause_until_ns = now_ns + pause_ns
    return max(pause_ns, c.policy.startup_timeout_ms * NS_PER_MS)


def give(c: Course, given: list[TrialAction], now_ns: int) -> None:
    """Give the court's orders, and do what a conviction means for everything else."""
    for one in given:
        order(c, one)
        if isinstance(one, SetAside) and not (one.letter.held or one.again):
            _convicted(c, one, now_ns)


def _convicted(c: Course, convicted: SetAside, now_ns: int) -> None:
    letter = convicted.letter
    found = next((one for one in c.court.register if one.letter == letter.id), None)
    assert found is not None, "whoever is convicted is remembered"
    if found.at_ns in c.budget.deaths_ns:
        telling.keep(c, c.budget.without(found.at_ns))
    if c.phase is Phase.FATAL and c.hopeless is Diagnosis.CRASH_LOOP and not c.budget.spent(now_ns):
        c.deadline.due_ns = now_ns  # what it had given up over is explained: the slow retry is due
    if found.kind != DRILL_KIND and found.blame is not None and c.policy.asks(found.blame, Word.SEND_ALERT):
        text = f"What ended the core was found and is set aside (letter {letter.id}). It can't do it again."
        telling.say(c, found.blame, text)


def _mark_near(c: Course, page: Page, at_ns: int) -> None:
    """Note what was finished shortly before a death that nobody was at work in; tell what is near the third in a row."""
    assert c.story is not None, "read of an open incident"
    near = [note for note in page.finished if at_ns - max(note.stage_ns, note.started_ns) <= NEAR_NS]
    words = frozenset(word for note in near for word in (f"request {note.key_hash}", f"kind {note.kind}"))
    c.near = (*c.near, words)[-NEAR_DEATHS:]
    if len(c.near) == NEAR_DEATHS:
        for word in sorted(frozenset.intersection(*c.near) - {"request ", "kind "}):
            why = f"{word} had finished within 2 s before each of the last {NEAR_DEATHS} deaths: likely, not proven"
            c.story.add_evidence((Testimony("near", Colour.YELLOW, why),))


def _fall(c: Course, life: int, now_ns: int) -> Fall:
    """Return the death of this life as it was first told; of one that nobody told, a new one."""
    known = next((fall for fall in c.falls if fall.life == life), None)
    if known is None:
        known = Fall(life, now_ns)
        c.falls = (*c.falls, known)[-FALLS_MAX:]
    return known


def _tried_in(c: Course, incident: str) -> bool:
    return c.court.log is not None and c.court.log.incident == incident


def _keep(c: Course) -> None:
    for one in c.court.kept():
        order(c, one)
