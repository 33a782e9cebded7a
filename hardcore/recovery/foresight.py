"""What the guard expects to run out, kept as plain values: one track for each resource, and the forecasts that stand.

Values come from the facts that the manager hears anyway, at most one a second. Those of a process begin anew with each
life, after a time in which everything grows; a disk goes on. A switch that was made because of a forecast is judged:
the next core has to begin lower, or it was no leak and another switch would not help either. What is done about a
forecast is `foretelling.py`.
"""

import math
from collections.abc import Iterator

import msgspec

from hardcore.model.forecasts import Forecast, Resource
from hardcore.model.observations import Sampled, Surveyed
from hardcore.recovery.budget import NS_PER_S
from hardcore.recovery.policy import Policy
from hardcore.sentinel.trends import Claim, Track, tell
from hardcore.sentinel.trends_log import Chatter

#: Facts come ten times a second; one in so long is enough.
LOOK_NS = NS_PER_S
#: Commands that may wait: the slots of a recorder page.
SLOTS = 256
#: A switch helped if the next core begins below this share of what the last one held.
LOWER_SHARE = 0.9
DAY_NS = 86_400 * NS_PER_S
#: What belongs to a process, so that another one begins anew with it.
OF_A_LIFE = (Resource.MEMORY, Resource.FDS, Resource.THREADS, Resource.QUEUE)
#: What grows in the first minutes of every process.
_WARMS_UP = frozenset({Resource.MEMORY, Resource.FDS, Resource.THREADS})
_NS_PER_HOUR = 3600 * NS_PER_S


class Numbers(msgspec.Struct, frozen=True):
    """The policy's numbers of the prediction. `limits`: those that are known from the beginning."""

    step_ns: int
    warmup_ns: int
    confirm_ns: int
    horizon_ns: int
    memory_bytes: int
    threads: int
    floor_bytes: int


def numbers(policy: Policy) -> Numbers:
    """Return what the prediction goes by."""
    return Numbers(
        policy.forecast_interval_sec * NS_PER_S,
        policy.forecast_warmup_sec * NS_PER_S,
        policy.forecast_confirm_sec * NS_PER_S,
        policy.forecast_horizon_sec * NS_PER_S,
        policy.memory_limit_mb << 20,
        policy.threads_max,
        policy.disk_floor_mb << 20,
    )


class Judgement(msgspec.Struct):
    """A switch because of a forecast, to be judged by what the next core begins with."""

    resource: Resource
    before: int
    life: int  # the one that was left
    lowest: int | None = None
    until_ns: int | None = None  # the next core is looked at until then


class Foresight(msgspec.Struct):
    """All that is remembered for the prediction. Times are monotonic."""

    life: int = 0
    looked_ns: int = 0
    done: int = 0  # commands that this life has completed
    private: bool = False  # its memory is told without what it shares with others
    tracks: dict[Resource, Track] = msgspec.field(default_factory=dict)
    limits: dict[Resource, int] = msgspec.field(default_factory=dict)
    log: Chatter | None = None
    forecasts: dict[Resource, Forecast] = msgspec.field(default_factory=dict)
    asked_ns: int | None = None  # when a switch was last asked for in this life
    vain_ns: dict[Resource, int] = msgspec.field(
        default_factory=dict
    )  # when the last one was seen not to have helped
    judgement: Judgement | None = None

    def begin(self, life: int, now_ns: int, with_numbers: Numbers) -> None:
        """Another life is looked at: what belongs to a process begins anew."""
        self.life, self.done, self.private, self.asked_ns = life, 0, False, None
        for resource in OF_A_LIFE:
            self.tracks.pop(resource, None)
            self.forecasts.pop(resource, None)
        self.limits.pop(Resource.FDS, None)
        self.forecasts.pop(Resource.ERRORS, None)
        self.log = Chatter(with_numbers.step_ns, now_ns + with_numbers.warmup_ns)
        if self.judgement is not None and life != self.judgement.life:
            self.judgement.until_ns = now_ns + with_numbers.step_ns

    def look(self, resource: Resource, value: int, now_ns: int, by: Numbers) -> Forecast | None:
        """Note a value of a resource whose limit is known; return a forecast that is to be told now."""
        limit = self.limits.get(resource)
        if limit is None:
            return None
        track = self.tracks.get(resource)
        if track is None or track.step_ns != by.step_ns:
            late_ns = by.warmup_ns if resource in _WARMS_UP else 0
            track = self.tracks[resource] = Track(by.step_ns, now_ns + late_ns)
        if not track.look(now_ns, value, self.done, limit, by.horizon_ns):
            return None
        told = tell(track, now_ns, by.confirm_ns)
        if not track.told:
            self.forecasts.pop(resource, None)
            return None
        if track.claim is not None:
            self.forecasts[resource] = _forecast(resource, track.claim, limit, track, now_ns)
        return self.forecasts[resource] if told else None

    def hear_log(self, counted: int, now_ns: int, by: Numbers) -> Forecast | None:
        """Note what the log counts; return a forecast that is to be told now."""
        if self.log is None or not self.log.look(now_ns, counted):
            return None
        found, told = self.log.excess(by.confirm_ns), self.log.told
        self.log.told = found is not None
        if found is None:
            self.forecasts.pop(Resource.ERRORS, None)
            return None
        least, usual = found
        why = f"the core's log says at least {least} errors and warnings in each {by.step_ns // NS_PER_S} s; {usual} is much"
        since_ns = self.forecasts[Resource.ERRORS].since_ns if told else now_ns
        made = Forecast(Resource.ERRORS, least, usual, 0.0, 0.0, since_ns, now_ns, now_ns, why)
        self.forecasts[Resource.ERRORS] = made
        return None if told else made

    def begins_no_lower(self, resource: Resource, value: int, now_ns: int) -> Judgement | None:
        """Judge the last switch by what the next core begins with; return it once it is clear that it has not helped."""
        judged = self.judgement
        if judged is None or judged.until_ns is None or judged.resource is not resource:
            return None
        judged.lowest = value if judged.lowest is None else min(value, judged.lowest)
        if judged.lowest < LOWER_SHARE * judged.before:
            self.judgement = None
        elif now_ns >= judged.until_ns:
            self.judgement, self.vain_ns[resource] = None, now_ns
            return judged
        return None

    def in_vain(self, resource: Resource, now_ns: int) -> bool:
        """Return whether a switch of the last day, because of this resource, was seen not to have helped."""
        vain_ns = self.vain_ns.get(resource)
        return vain_ns is not None and now_ns - vain_ns < DAY_NS

    def soonest(self, life: int) -> tuple[Forecast, ...]:
        """Return the forecasts that stand for this life, the soonest first: those of another end with it."""
        stand = [one for one in self.forecasts.values() if life == self.life or one.resource is Resource.DISK]
        return tuple(sorted(stand, key=lambda one: one.due_ns))


def of_sample(fact: Sampled, *, private: bool) -> Iterator[tuple[Resource, int]]:
    """Return what a look at the core tells. `private`: its memory is told better elsewhere."""
    if fact.process is not None:
        if not private:
            yield Resource.MEMORY, fact.process.rss_bytes
        yield Resource.THREADS, fact.process.threads
    if fact.beats is not None:
        yield Resource.QUEUE, fact.beats.waiting


def of_survey(fact: Surveyed) -> Iterator[tuple[Resource, int]]:
    """Return what a survey tells."""
    if fact.private_bytes is not None:
        yield Resource.MEMORY, fact.private_bytes
    if fact.disk is not None and 0 < fact.disk.free_bytes <= fact.disk.size_bytes:
        yield Resource.DISK, fact.disk.size_bytes - fact.disk.free_bytes


def told_amount(resource: Resource, amount: float) -> str:
    """Return an amount of a resource in words."""
    if resource in {Resource.MEMORY, Resource.DISK}:
        return f"{amount / (1 << 20):.0f} MiB"
    return f"{amount:.0f}"


def _forecast(resource: Resource, claim: Claim, limit: int, track: Track, now_ns: int) -> Forecast:
    """Return a claim in hours and moments. Its slope is of stretches as long as the scale that it was seen on."""
    hour = _NS_PER_HOUR / (track.step_ns * claim.scale)
    per_hour, low = claim.slope.middle * hour, claim.slope.low * hour
    due_ns = now_ns + math.ceil(claim.due * track.step_ns)
    late_ns = now_ns + math.ceil(claim.due_late * track.step_ns)
    why = (
        f"{resource}: {told_amount(resource, claim.level + claim.swing)} of {told_amount(resource, limit)}, growing by "
        f"{told_amount(resource, per_hour)} an hour, at least {told_amount(resource, low)}; "
        f"the limit is reached in about {max(1, round((due_ns - now_ns) / (60 * NS_PER_S)))} min"
    )
    since_ns = track.since_ns if track.since_ns is not None else now_ns
    return Forecast(resource, float(claim.level), float(limit), per_hour, low, since_ns, due_ns, late_ns, why)
