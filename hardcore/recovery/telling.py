"""What is told of an outage while it goes on: incidents opened, joined and closed, alerts, orders for evidence.

One outage is one incident, however many deaths it takes; one trouble is one, however often it comes and goes. So the
question here is always whether something belongs to the open story: a death does until a proven core has served,
and as long as reads only are served by a core that was started for it. An end in the middle of a trouble does not.
"""

from hardcore.model.actions import Action, Alert, AlertStage, CloseIncident, KeepBudget, TakeEvidence
from hardcore.model.phases import SERVING, Phase, StartCause, Wanted
from hardcore.model.verdicts import Colour, Diagnosis, Grade, Testimony
from hardcore.recovery import mandate, plan
from hardcore.recovery.budget import NS_PER_S, Budget
from hardcore.recovery.course import Course
from hardcore.recovery.policy import Word
from hardcore.recovery.safety import DISK, PASSING, SLOW
from hardcore.recovery.story import Story, Trouble, begin
from hardcore.sentinel.deaths import Death

#: A gateway that began to hold this shortly before the death was known held because of it.
HELD_EARLY_NS = NS_PER_S
#: What can become of an incident, in words.
OUTCOMES = {
    "recovered": "all is served again",
    "safe_mode": "reads only are served",
    "manual": "a person is needed",
    "assist": "nothing was done about it, as the mode says",
}
BOOTING = frozenset({Phase.STARTING, Phase.SWITCHING, Phase.PROVING})


def order(c: Course, action: Action) -> None:
    """Give an order."""
    c.actions.append(action)


def mark(c: Course, name: str, at_ns: int) -> None:
    """Note a step of the open incident's timeline, if one is open."""
    if c.story:
        c.story.mark(name, at_ns)


def alert(c: Course, diagnosis: Diagnosis, text: str, stage: AlertStage = AlertStage.OPENED) -> None:
    """Say something to whoever runs the server, if the policy wants that said."""
    if c.policy.asks(diagnosis, Word.SEND_ALERT):
        say(c, diagnosis, text, stage)


def say(c: Course, diagnosis: Diagnosis, text: str, stage: AlertStage = AlertStage.OPENED) -> None:
    """Say it whatever the policy wants said on that diagnosis; but a guard that only records tells nobody."""
    if mandate.is_mute(c):
        return
    incident = c.story.id if c.story is not None else None
    if c.story is not None and stage is not AlertStage.FORECAST:
        c.story.alerted = True  # whoever was told of it, however, is told what became of it
    order(c, Alert(diagnosis, text, incident, stage))


def _say_closed(c: Course, story: Story, outcome: str) -> None:
    outage_ms = story.outage_ms()
    took = "" if outage_ms is None else f" Nobody was served for {outage_ms} ms."
    text = f"{story.diagnosis} is over: {OUTCOMES[outcome]}.{took}"
    order(c, Alert(story.diagnosis, text, story.id, AlertStage.CLOSED, outcome, outage_ms))


def worst(death: Death) -> str:
    """Return the worst that was said: the first witness may have had nothing to complain of."""
    worst = max(death.evidence, key=lambda fact: (fact.colour is Colour.RED, fact.colour is Colour.YELLOW))
    return worst.why


def open_death(c: Course, now_ns: int, *, planned: bool) -> None:
    """Open an incident for the pending death, or note it as a further one of the open incident."""
    trouble = _take(c)
    death = trouble.death
    c.blame, c.unseen = death.diagnosis, death.grade is Grade.UNKNOWN and trouble.exit is not None
    c.consent = planned or trouble.asked or (c.consent and c.phase is Phase.DRAINING)
    c.reader_tried = c.reader_tried and not planned  # a person's word is worth a try of its own
    drill = c.drill.take(death.diagnosis, now_ns)
    if c.phase is Phase.PROBATION and not _goes_on(c):
        close(c, now_ns, recovered=True)  # a proven core had served: what comes now is another story
    joins = trouble.asked and c.story is not None and c.story.diagnosis is death.diagnosis
    if joins and c.story is not None:
        c.story.withheld = False  # a person has come, and wants it done
        c.troubles.clear()
    if c.phase in SERVING and c.story is not None and not (c.story.planned or c.story.deaths or joins):
        close(c, now_ns, recovered=True)  # a trouble that stopped nobody: an end is never told under its name
    if c.phase in SERVING and c.story is not None and not c.story.down and c.story.planned and not planned:
        close(c, now_ns, recovered=True)  # a core that could not be drained was serving again
    if c.story is None or c.story.planned:
        _begin(c, trouble, now_ns, planned=planned).drill = drill
    story = _story(c)
    story.blame(death.evidence, trouble.blamed)
    story.exit = story.exit or trouble.exit
    story.add_page(trouble.page, suspected_of(c), c.growth)
    story.falls(trouble.fault_ns, now_ns)
    if planned:
        c.cause = StartCause.PLANNED
        return
    again = c.phase in BOOTING and c.trying is death.diagnosis
    locked_out = c.phase in BOOTING and death.diagnosis in {Diagnosis.DB_LOCKED, Diagnosis.STORE_AWAY}
    if death.diagnosis is Diagnosis.DB_LOCKED and locked_out and c.holder is not None:
        story.add_evidence((c.holder,))
    c.worth_a_look = not again
    if drill is None and not again:
        alert(c, death.diagnosis, f"{worst(death)}. Recovery has begun.")
    story.add_death(death.diagnosis, trouble.exit, trouble.fault_ns)
    if c.cause is not StartCause.FIRST or c.phase in SERVING:
        c.cause = StartCause.UNPLANNED
    if death.diagnosis is not Diagnosis.SENTINEL_LOST:
        # No other core tries what a disk refuses: one is started to read, however often that happens.
        refused = death.diagnosis in DISK and not c.policy.asks(death.diagnosis, Word.REBOOT_PROCESS)
        _count(c, death.diagnosis, now_ns, free=drill is not None or again or locked_out or refused)


def open_trouble(c: Course, now_ns: int) -> None:
    """Open an incident without a death for the pending trouble, or note it in the open one."""
    trouble = _take(c)
    death = trouble.death
    c.troubled = death.diagnosis
    ours = c.troubles.on or c.reader is not None
    left = mandate.watches_only(c)
    joins = c.story is not None and (ours or c.story.diagnosis is death.diagnosis)
    if not joins:
        close(c, now_ns, recovered=True)
        _begin(c, trouble, now_ns, down=False).drill = c.drill.take(death.diagnosis, now_ns)
    story = _story(c)
    story.withheld = story.withheld or left
    story.blame(death.evidence, trouble.blamed)
    known = joins and story.diagnosis is death.diagnosis
    c.worth_a_look = c.troubles.meets(death.diagnosis) and not known
    if c.worth_a_look and story.drill is None:
        goes_on = f"Mode {c.policy.mode} leaves it to you." if left else "The core goes on."
        alert(c, death.diagnosis, f"{worst(death)}. {goes_on}")


def open_unwatched(c: Course, now_ns: int) -> None:
    """Open an incident that stopped nobody: the pending trouble is a guard's, not the core's."""
    trouble = _take(c)
    story = _begin(c, trouble, now_ns, down=False)
    story.drill = trouble.drill
    story.blame(trouble.death.evidence, ())
    if story.drill is None:
        alert(c, trouble.death.diagnosis, f"{worst(trouble.death)}.")


def open_aside(c: Course, trouble: Trouble, now_ns: int) -> None:
    """Open an incident that a person asked for and that stops nobody, unless one is open."""
    if c.story is None:
        _begin(c, trouble, now_ns, planned=True, down=False)
        _story(c).blame(trouble.death.evidence, ())


def close_aside(c: Course, now_ns: int) -> None:
    """Close such an incident: what was asked for is done, or was refused."""
    if (
        c.story is not None
        and c.story.planned
        and not (c.story.deaths or c.story.down)
        and c.phase in SERVING
    ):
        close(c, now_ns, recovered=True)


def close(c: Course, now_ns: int, *, recovered: bool) -> None:
    """Close the open incident, if there is one. `recovered`: a core serves everything again."""
    if c.story is None:
        return
    if c.repair.name and c.repair.asked and c.story.planned and not c.story.down:
        why = f"the part {c.repair.name} was to begin anew, and nobody had answered when something else came"
        c.story.add_evidence((Testimony("parts", Colour.YELLOW, why),))
    # A stop in the middle of the probation does not undo a recovery: a proven core had served.
    unwanted = c.wanted is Wanted.DOWN
    handed_over = left_to_a_person(c) if recovered else None
    if c.story.safe and (recovered or unwanted):
        outcome = "safe_mode"
    else:
        well = recovered or (unwanted and c.story.proof is not None)
        outcome = "recovered" if well and handed_over is None else "manual"
    outcome = "assist" if c.story.withheld else outcome
    waits_for = handed_over if recovered else c.hopeless
    order(c, CloseIncident(c.story.told(outcome, now_ns, waits_for, c.court.register.notes(c.story.id))))
    if c.story.alerted and not mandate.is_mute(c):
        _say_closed(c, c.story, outcome)
    c.story = None
    c.stage_max = 0
    c.troubles.clear()
    if not c.safety.troubled:
        c.safety.forget()


def close_switch(c: Course, why: str, now_ns: int) -> None:
    """Close the incident of a switch that was given up, if it has come to one: the same core goes on."""
    if c.story is not None and c.story.planned and not c.story.deaths and c.phase in SERVING:
        c.story.add_evidence((Testimony("switch", Colour.YELLOW, f"it was given up: {why}"),))
        close(c, now_ns, recovered=True)


def close_if_over(c: Course, now_ns: int, after: Phase) -> None:
    """Close the open incident on the way to `after`, unless its trouble goes on in a core that serves.

    What only a person can end is closed at once: its report is what that person needs.
    """
    if after not in SERVING or not _goes_on(c) or left_to_a_person(c):
        close(c, now_ns, recovered=after in SERVING)


def left_to_a_person(c: Course) -> Diagnosis | None:
    """Return why nothing more is done by itself about a core that serves, or None."""
    if c.safety.trouble is not None:
        return c.safety.trouble if c.safety.trouble not in PASSING else None
    damaged = Diagnosis.STORE_CORRUPT
    told = damaged in c.troubles.known and not c.policy.asks(damaged, Word.SAFE_MODE_ENTER)
    return damaged if told else None


def keep(c: Course, budget: Budget) -> None:
    """Let this be the budget from now on."""
    c.budget = budget
    order(c, KeepBudget(budget.deaths_ns, c.hopeless if c.shut else None))


def suspected_of(c: Course) -> Diagnosis | None:
    """Return what the commands of the present life may be suspected of; None: nobody knows how it ended."""
    return None if c.unseen else c.blame


def order_evidence(c: Course, *, living: bool) -> None:
    """Have the evidence of an end taken, if the policy or the operator wants any."""
    image = living and (c.policy.memory_image == "always" or c.image_asked)
    if not (image or c.policy.asks(c.blame, Word.SNAPSHOT)):
        c.skip_evidence = living
        return
    if living or c.worth_a_look:
        budget_ms = c.policy.snapshot_budget_ms
        order(c, TakeEvidence(c.life, _story(c).id, living, budget_ms, image=image))


def order_evidence_beside(c: Course) -> None:
    """Have the evidence of a trouble taken while the core goes on, once for each trouble of an incident."""
    assert c.troubled is not None, "evidence is taken of a trouble that was named"
    if c.worth_a_look and c.policy.asks(c.troubled, Word.SNAPSHOT):
        budget_ms = c.policy.snapshot_budget_ms
        order(c, TakeEvidence(c.life, _story(c).id, living=True, budget_ms=budget_ms, stop=False))


def pending(c: Course) -> Trouble:
    """Return what is about to be told."""
    assert c.pending is not None, "an incident is opened only for a trouble that was named"
    return c.pending


def _take(c: Course) -> Trouble:
    trouble, c.pending = pending(c), None
    return trouble


def _story(c: Course) -> Story:
    assert c.story is not None, "an incident is open here"
    return c.story


def _goes_on(c: Course) -> bool:
    """Whether the open incident's trouble is still there, so that no core has made an end of it."""
    return c.troubles.on or c.safety.troubled or c.reader is not None


def _begin(c: Course, trouble: Trouble, now_ns: int, *, planned: bool = False, down: bool = True) -> Story:
    known, epoch = c.story.id if c.story else c.given.new_id(), c.store.epoch or 0
    c.story = begin(known, c.story, trouble, c.life, epoch, now_ns, planned=planned, down=down)
    if c.held_ns is not None and now_ns - c.held_ns <= HELD_EARLY_NS:
        c.story.mark("alerted", now_ns)
    return c.story


def _count(c: Course, diagnosis: Diagnosis, now_ns: int, *, free: bool) -> None:
    """Put an unplanned death on the budget and judge whether another try makes sense."""
    unproven = c.phase in {Phase.STARTING, Phase.PROVING, Phase.PROBATION}
    if unproven and not (c.promoted and c.phase in BOOTING):  # a spare that fails has a core to fall back on
        c.tries += 1
    if not free:
        keep(c, c.budget.after_death(now_ns))
    locked = Diagnosis.STORE_CORRUPT if c.safety.locked else None
    spent = c.budget.spent(now_ns)
    damaged = diagnosis is Diagnosis.STORE_CORRUPT
    failed = c.trying if c.trying in SLOW and not damaged else None  # the try has shown that reading goes on
    c.hopeless = c.reader or locked or failed or plan.hopeless(c.policy, diagnosis, spent=spent)
    if spent and plan.passes(c.policy, c.hopeless):
        c.hopeless = Diagnosis.CRASH_LOOP  # readers that die count as any other
    c.shut = c.hopeless is not None and c.policy.asks(c.hopeless, Word.SHUTDOWN)
    if c.shut:
        keep(c, c.budget)
