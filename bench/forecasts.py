"""How often the prediction is right: leaks told of before their limit, false alarms in a thousand healthy hours.

The traces are made from seeds (`tests/corpus`) and given to the same code that runs in the guard, with the numbers that
it ships with. The seeds here were never looked at while those numbers were chosen: a rate measured on what one has
tuned to says nothing. No clock is read, so a busy machine changes nothing but how long it takes.
"""

import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from bench.figures import Figure, Target
from tests.corpus.judging import Judged, judge
from tests.corpus.traces import healthy, leak

#: Chosen by nobody: the first seeds after those that were tuned with (0 to 9,999).
FIRST_SEED = 10_000
FOUND_PERCENT_MIN = 90
FALSE_MAX = 1.0
#: The prediction may cost one percent of a processor where a stretch lasts a minute.
COST_PERCENT_MAX = 1.0


def measure(_folder: Path, *, hours: int, leaks: int, say: Callable[[str], None]) -> list[Figure]:
    """Judge healthy traces of so many hours together, and so many leaks."""
    began_ns, looks = time.process_time_ns(), 0
    quiet, watched_h, seed = [], 0.0, FIRST_SEED
    while watched_h < hours:
        quiet.append(judge(healthy(seed)))
        watched_h, seed = watched_h + quiet[-1].trace.hours, seed + 1
    found = [judge(leak(seed)) for seed in range(FIRST_SEED, FIRST_SEED + leaks)]
    took_ns = time.process_time_ns() - began_ns
    looks = sum(len(one.trace.values) for one in (*quiet, *found))
    for line in (*_kinds("healthy", quiet), *_kinds("leaks", found)):
        say(line)
    alarms = sum(len(one.told_s) for one in quiet)
    leads_min = tuple(one.lead_s / 60 for one in found if one.lead_s is not None)
    percent = 100 * len(leads_min) / len(found)
    return [
        Figure(
            f"leaks told of before their limit, of {leaks}",
            "%",
            (percent,),
            target=Target(FOUND_PERCENT_MIN, least=True),
        ),
        Figure(
            f"false alarms in 1,000 h, of {watched_h:.0f} h",
            "",
            (1000 * alarms / watched_h,),
            target=Target(FALSE_MAX),
        ),
        Figure("how long before the limit", "min", leads_min or (0.0,)),
        Figure(
            "one resource looked at each second, of one core",
            "%",
            (100 * took_ns / looks / 1e9,),
            target=Target(COST_PERCENT_MAX),
        ),
    ]


def _kinds(name: str, judged: list[Judged]) -> list[str]:
    """Return a line for each kind: how many traces, how many hours, in how many something was told at the end."""
    traces = Counter(one.trace.kind for one in judged)
    told = Counter(one.trace.kind for one in judged if one.told_s)
    stood = Counter(one.trace.kind for one in judged if one.lead_s is not None)
    hours: Counter[str] = Counter()
    for one in judged:
        hours[one.trace.kind] += round(one.trace.hours)
    return [
        f"{name}: {kind}, {traces[kind]} traces, {hours[kind]} h, told of in {told[kind]}, to the end in {stood[kind]}"
        for kind in sorted(traces)
    ]
