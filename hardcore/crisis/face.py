"""What a page is told of an outage: when it began, how far the recovery is, which text is true now.

An outage is folded from what the gateway knows (`standing`), so that it begins with the gateway's own doubt as
well as with the guard's word, and ends only with a released core. A doubt is told to nobody before it is more than
a doubt (`is_sure`): one lost connection, and a gateway that has not heard of the core yet, are no outage of the
core. What is shown follows from it and the time:
the stage never goes back, a promised time never grows, and a text is said only where its facts are. Passing the
feed's fields on as they come was not chosen: stage and begin are of the phase there, and a page needs the outage's.
"""

from collections.abc import Sequence
from enum import StrEnum

import msgspec
from msgspec import structs

from hardcore.crisis.estimate import Sample, Told, Way, estimate, in_seconds, narrowed, of_way, sample
from hardcore.crisis.standing import Standing, posture
from hardcore.model.phases import Face, HAState, Phase

NS_PER_MS = 1_000_000
STAGES = 4
#: Phases that say which way the next core comes. The later one counts: a spare may fail to take over.
_WAYS = {Phase.SWITCHING: Way.SPARE, Phase.STARTING: Way.COLD, Phase.BACKOFF: Way.COLD}


class Text(StrEnum):
    """Which text of the catalogue is true.

    UNTOLD: it takes longer, and nobody could be told; of LONGER it is known only if `alerted_at` says so.
    """

    RECOVERING = "R1"
    PLANNED = "R2"
    LONGER = "R7"
    UNTOLD = "R7b"
    STOPPED_TRYING = "R8"
    OFF = "OFF"


class Pace(msgspec.Struct, frozen=True):
    """When time alone changes what is told.

    A wait counts as long without a promise after `longer_than_ms`, with one never before `floor_ms`; nobody is
    told of a doubt before `doubt_ms`, unless it is confirmed.
    """

    longer_than_ms: int
    floor_ms: int
    doubt_ms: int


class Outage(msgspec.Struct, frozen=True):
    """One time without a core. Times are monotonic nanoseconds.

    `epoch`: the core that served before it, None if this gateway saw none; `reached`: when each stage was first
    reached; `told`: the narrowest promise so far; `plain`: neither the operator nor a last resort was part of it;
    `said`: the guard said so; `sure`: somebody knows of it (see `is_sure`); `measured`: its begin is known, and so is
    its length; `way`: how the next core comes, None while nobody knows; `of`: how many outages that were ended this way are known.
    """

    began_ns: int
    epoch: int | None
    reached: tuple[tuple[int, int], ...]
    planned: bool = False
    plain: bool = True
    told: Told | None = None
    said: bool = False
    sure: bool = False
    measured: bool = False
    way: Way | None = None
    of: int = 0

    @property
    def stage(self) -> int:
        """The highest stage so far."""
        return self.reached[-1][0]


class Shown(msgspec.Struct, frozen=True):
    """One moment of an outage as a page is told it; `text` None: the ledger is being served."""

    state: str
    phase: str
    incident: str | None = None
    stage: int | None = None
    began_ns: int | None = None
    elapsed_ms: int = 0
    eta: Told | None = None
    samples: int = 0
    planned: bool = False
    text: Text | None = None
    safe: str | None = None
    sound: bool | None = None
    alerted_at: str | None = None


def follow(
    outage: Outage | None, before: Standing, known: Standing, samples: Sequence[Sample], now_ns: int
) -> Outage | None:
    """The outage after something was learned (`before` became `known`); None while a core serves.

    Its length is known where this gateway saw the core serve before it, or the guard names an incident: what
    the guard says of the time otherwise is its phase's.
    """
    if posture(known) is Face.FORWARD:
        return None
    if outage is None:
        served = before.serving.epoch if before.serving and posture(before) is Face.FORWARD else None
        outage = Outage(now_ns, served, (), measured=served is not None)
    if known.unanswered:
        outage = structs.replace(outage, sure=True)
    if known.phase and known.face is not Face.FORWARD:
        # The guard knows better than we when it began; a doubt of our own may have been earlier still.
        began_ns = min(outage.began_ns, known.since_ns or now_ns)
        plain = outage.plain and known.face is Face.HOLD
        measured = outage.measured or known.incident is not None
        outage = structs.replace(
            outage,
            began_ns=began_ns,
            planned=known.planned,
            plain=plain,
            said=True,
            sure=True,
            measured=measured,
            way=_WAYS.get(Phase(known.phase), outage.way) if known.phase in set(Phase) else outage.way,
        )
    return _reach(outage, known.stage or 1, samples, now_ns)


def _reach(outage: Outage, stage: int, samples: Sequence[Sample], now_ns: int) -> Outage:
    """Note that a stage was reached, and promise anew: nothing before it is known which way the core comes."""
    if outage.reached and stage <= outage.stage:
        return outage
    alike = of_way(samples, outage.way) if outage.way is not None else ()
    promise = estimate(alike, stage, _elapsed_ms(outage, now_ns))
    told = narrowed(outage.told, in_seconds(promise) if promise is not None else None)
    reached = (*outage.reached, (stage, now_ns))
    return structs.replace(outage, reached=reached, told=told, of=len(alike))


def is_sure(outage: Outage, pace: Pace, now_ns: int) -> bool:
    """Whether pages may be told of it: the guard said so, a core in doubt did not answer, or it lasts."""
    return outage.sure or _elapsed_ms(outage, now_ns) >= pace.doubt_ms


def length_ms(outage: Outage, now_ns: int) -> int | None:
    """How long it has lasted; None: nobody knows when it began."""
    return _elapsed_ms(outage, now_ns) if outage.measured else None


def _elapsed_ms(outage: Outage, now_ns: int) -> int:
    return max(0, now_ns - outage.began_ns) // NS_PER_MS


def finished(outage: Outage, epoch: int, now_ns: int) -> Sample | None:
    """What an outage that is over teaches; None if its length says nothing about the next.

    That is so where nobody saw its begin or which way its end came, where a person took part in it, and where the same
    core went on.
    """
    if outage.epoch is None or outage.epoch == epoch or not outage.plain or outage.way is None:
        return None
    reached = [(stage, max(0, at_ns - outage.began_ns) // NS_PER_MS) for stage, at_ns in outage.reached]
    return sample(_elapsed_ms(outage, now_ns), reached, outage.way, outage.told)


def show(outage: Outage | None, known: Standing, samples: int, pace: Pace, now_ns: int) -> Shown:
    """What a page is told at this moment."""
    if outage is None or not is_sure(outage, pace, now_ns):
        return Shown(
            known.state,
            known.phase,
            known.incident,
            samples=samples,
            safe=known.safe,
            sound=known.sound,
        )
    elapsed_ms = _elapsed_ms(outage, now_ns)
    late = elapsed_ms > _limit_ms(outage, pace)
    past = outage.told is not None and elapsed_ms > _promised_ms(outage.told)
    alerted_at, untold = _alerted(known)
    text = _text(outage, known.face, late=late, untold=untold)
    open_ended = past or text not in {Text.RECOVERING, Text.PLANNED}
    return Shown(
        # The guard may not have said anything yet of what we saw ourselves: its words are older then.
        state=known.state if known.face is not Face.FORWARD else HAState.RECOVERY,
        phase=known.phase if outage.said else "",
        incident=known.incident,
        stage=outage.stage,
        began_ns=outage.began_ns,
        elapsed_ms=elapsed_ms,
        eta=None if open_ended else outage.told,
        samples=samples if outage.way is None else outage.of,
        planned=outage.planned,
        text=text,
        safe=known.safe,
        sound=known.sound,
        alerted_at=alerted_at,
    )


def _alerted(known: Standing) -> tuple[str | None, bool]:
    """When whoever runs the server was told of the incident that is shown, and whether that failed."""
    told = known.alerted
    if told is None or known.incident is None or told.incident != known.incident:
        return None, False
    return told.at, told.failed


def _text(outage: Outage, face: Face, *, late: bool, untold: bool) -> Text:
    if face is Face.CLOSED:
        return Text.OFF
    if face is Face.REFUSE:
        return Text.STOPPED_TRYING
    if late:
        return Text.UNTOLD if untold else Text.LONGER
    return Text.PLANNED if outage.planned else Text.RECOVERING


def _promised_ms(told: Told) -> int:
    """The end of what was promised, as it was said."""
    return told.high_s * 1000


def _limit_ms(outage: Outage, pace: Pace) -> int:
    if outage.told is None:
        return pace.longer_than_ms
    return max(_promised_ms(outage.told), pace.floor_ms)


def due_ms(outage: Outage, pace: Pace, now_ns: int) -> int | None:
    """In how many milliseconds what is shown changes by time alone; None: not any more."""
    elapsed_ms = _elapsed_ms(outage, now_ns)
    if not is_sure(outage, pace, now_ns):
        return pace.doubt_ms - elapsed_ms
    marks = [_limit_ms(outage, pace)] + ([_promised_ms(outage.told)] if outage.told else [])
    ahead = [mark - elapsed_ms for mark in marks if mark >= elapsed_ms]
    return min(ahead) + 1 if ahead else None


def fields(shown: Shown, held: int, since: str | None) -> dict[str, object]:
    """The `state` frame for a browser of which `held` requests wait. `since`: the begin as RFC 3339."""
    eta = None
    if shown.eta is not None:
        eta = {"low_s": shown.eta.low_s, "high_s": shown.eta.high_s, "samples": shown.samples}
    return {
        "v": 1,
        "type": "state",
        "state": shown.state or "UNKNOWN",
        "phase": shown.phase or "UNKNOWN",
        "stage": shown.stage,
        "stages": STAGES,
        "since": since,
        "elapsed_ms": shown.elapsed_ms,
        "eta": eta,
        "samples": shown.samples,
        "incident": shown.incident,
        "held": held,
        "planned": shown.planned,
        "alerted_at": shown.alerted_at,
        "safe": shown.safe,
        "text": shown.text,
        "sound": shown.sound,
    }
