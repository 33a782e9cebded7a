"""The drills: break the running system on purpose, wait for what should come of it, and tell how it went.

Each fault is a real one, and each has one outcome that its table below promises. A drill that turns out
otherwise is a finding: exit code 1, and the incident to look at. `gc` is the other kind of drill: it makes a
healthy core look ill, and passes if nobody does anything about it. `spare` kills the core that waits: another one has
to come, and the one that serves must not notice. `sentinel` kills the guard itself: another has to watch the same core.
`leak` and `stall` show slowly, and end nobody: what comes of them is a planned switch, or a part that is begun anew.
"""

import hashlib
import http.client
import json
import subprocess
import sys
import time
from collections.abc import Mapping
from typing import Any, NoReturn

import click
import msgspec
from msgspec import structs

from frontend.catalogue import spare_lack
from frontend.catalogue_drills import done_words, end_words, promised_words
from hardcore.asked import LOOK_EVERY_S, Asked, come_back, next_words, operator, status_of, until
from hardcore.control.protocol import (
    DRILLS,
    LEAK_MB_PER_S,
    LEAK_MB_PER_S_MAX,
    LEAK_S,
    NAME_DIGITS,
    PEACE_S,
)
from hardcore.host.local_http import ask
from hardcore.lines import wrapped
from hardcore.looking_back import told_incident
from hardcore.recovery.drill import LEAK_S_MAX
from postmortem.dead_letters import spool

#: The longest way back: a transaction's whole time, a full disk's first tries, a restart and its probation.
BACK_S = 120.0
#: A spare starts at low priority and may take as long as any start.
SPARE_S = 90.0
#: As long as a gateway holds a request at most, and some more.
SENT_S = 60.0
SET_ASIDE = 422
#: After a leak has reached its end: a forecast's last stretch, a switch in a calm moment, and its probation.
LEAK_BACK_S = 60.0
#: Noticed sooner than this is noticed by no watch: the core has said so itself.
AT_ONCE_MS = 0.05


class Promise(msgspec.Struct, frozen=True):
    """What a drill must lead to."""

    diagnosis: str
    outcome: str = "recovered"


PROMISES: Mapping[str, Promise] = {
    "crash": Promise("CRASHED"),
    "segv": Promise("CRASHED"),
    "exit": Promise("EXITED"),
    "freeze": Promise("FROZEN"),
    "block": Promise("LOOP_BLOCKED"),
    "spin": Promise("SPINNING"),
    "gil": Promise("GIL_HELD"),
    "deadlock": Promise("DEADLOCK"),
    "slow-tx": Promise("TRANSACTION_TIMEOUT"),
    "oom": Promise("OUT_OF_MEMORY"),
    "dblock": Promise("DB_LOCKED"),
    "diskfull": Promise("DISK_FULL", "safe_mode"),
    "poison": Promise("CRASHED"),
    "gateway": Promise("GATEWAY_LOST"),
    "leak": Promise("LEAK"),
    "stall": Promise("COMPONENT_STALLED"),
}
#: A leak is foretold where the policy looks for long enough, and seen above the limit where it does not.
LEAKS = frozenset({"LEAK", "MEMORY_PRESSURE"})


@click.command()
@click.argument("fault", metavar="FAULT", type=click.Choice([*DRILLS, "restore"]))
@click.argument("component", required=False, default="")
@click.option("--yes", is_flag=True, help="Even while others are connected.")
@click.option("--seconds", type=click.IntRange(1, LEAK_S_MAX), help="How long a leak goes on.  [default 120]")
@click.option("--mb-per-s", type=click.IntRange(1, LEAK_MB_PER_S_MAX), help="How fast it leaks.  [default 8]")
@click.option("--scheduled", is_flag=True, hidden=True)
@operator
def drill(
    asked: Asked,
    fault: str,
    component: str,
    *,
    yes: bool,
    seconds: int | None,
    mb_per_s: int | None,
    scheduled: bool,
) -> None:
    """Break the core on purpose, wait for it to come back, and tell how it went.

    \b
    crash segv exit     it dies: by abort, by a bad memory access, by leaving
    freeze block        it stands still: the whole process, its event loop
    spin gil            it computes for ever, or holds the interpreter in C
    deadlock slow-tx    the writer: two locks in a circle, a transaction without end
    oom                 it takes memory until the kernel ends it (needs a memory cgroup)
    dblock              another process holds the ledger's lock: told, nothing is killed
    diskfull            the disk takes no write: reads go on, writes wait for room
    gc                  a long garbage collection: nothing may happen
    spare               the core that waits is killed: another comes, nobody notices
    poison              a request that kills whoever carries it out: one death, then it is set aside
    gateway             who holds the connections is killed: another accepts on the same address
    sentinel            the guard itself is killed: another goes on with the same core
    leak                memory is taken and kept: foretold, and another core takes over in a calm moment
    stall COMPONENT     one part stands still: it alone is begun anew, and the ledger answers all the while
    restore             a copy and the newest backup are restored and proven; works with everything stopped
    """  # noqa: D301  # the escape is click's own mark for a block that is not refilled
    _fits(fault, component, leak_named=bool(seconds or mb_per_s))
    result = Result(asked, fault, scheduled=scheduled)
    promised = promised_words(fault, asked.lang)
    if fault == "restore":
        asked.say("drill_begins", fault=fault, done=done_words(fault, asked.lang), promised=promised)
        _restores(result)
        return
    first = status_of(asked)
    how = {"seconds": seconds or LEAK_S, "mb_per_s": mb_per_s or LEAK_MB_PER_S} if fault == "leak" else {}
    begun = asked.ask(verb="drill", fault=fault, yes=yes, component=component, **how)
    asked.say("drill_begins", fault=fault, done=done_words(fault, asked.lang), promised=promised)
    match fault:
        case "spare":
            _another_waits(result, first)
        case "sentinel":
            _another_watches(result, first)
        case "gateway":
            _another_accepts(result, first)
        case "poison":
            _is_set_aside(result, first, str(begun["key"]))
        case "leak":
            _is_relieved(result, first, int(how["seconds"]))
        case "stall":
            _goes_on(result, first)
        case _ if fault in PROMISES:
            _comes_back(result, first)
        case _:
            _stays_calm(result, first.get("last_incident"))


def _fits(fault: str, component: str, *, leak_named: bool) -> None:
    """End with a sentence where what was named does not go with this drill."""
    if bool(component) != (fault == "stall"):
        raise click.UsageError(
            "A part is named for `stall`, and for no other drill: `hardcore drill stall importer`. "
            "`hardcore status --json` names the parts."
        )
    if leak_named and fault != "leak":
        raise click.UsageError("--seconds and --mb-per-s go with `leak` alone.")


class Result(msgspec.Struct, frozen=True):
    """What a drill has shown: said to whoever ran it, and kept for the dashboard. `end` and `fail` do not return."""

    asked: Asked
    fault: str
    scheduled: bool

    def end(self, told: Mapping[str, Any], sentence: str, *, ok: bool) -> NoReturn:
        """Tell how it went."""
        story = told.get("story") or {}
        self._keep(sentence, story, ok=ok)
        if not self.asked.json:
            click.echo(wrapped(sentence))
        self.asked.tell({"ok": ok, **told})
        sys.exit(0 if ok else 1)

    def fail(self, sentence: str) -> NoReturn:
        """Tell that nothing could be shown."""
        self._keep(sentence, {}, ok=False)
        self.asked.fail(sentence)

    def _keep(self, sentence: str, story: Mapping[str, Any], *, ok: bool) -> None:
        kept = spool.write(
            self.asked.folders.spool,
            "drill",
            {
                "fault": self.fault,
                "ok": ok,
                "incident": story.get("id"),
                "outage_ms": story.get("outage_ms"),
                "detected_ms": story.get("detected_ms"),
                "scheduled": self.scheduled,
                "sentence": sentence,
            },
        )
        if isinstance(kept, spool.SpoolFailed):
            click.echo(kept.reason, err=True)  # the drill has shown what it shows all the same


def _comes_back(result: Result, first: Mapping[str, Any]) -> None:
    """Wait for the incident of the drill, and hold it against what was promised."""
    asked, promise = result.asked, PROMISES[result.fault]
    story = _story_after(result, first)
    kept = (story["diagnosis"], story["outcome"]) == (promise.diagnosis, promise.outcome)
    sentence = asked.words(
        "drill_kept" if kept else "drill_other",
        promised=promised_words(result.fault, asked.lang),
        summary=story["summary"],
        by=asked.words(way_back(story)),
        detected=noticed(asked, story["detected_ms"]),
        incident=story["id"],
    )
    result.end(
        {"incident": story["id"], "promised": structs.asdict(promise), "story": story}, sentence, ok=kept
    )


def _story_after(result: Result, first: Mapping[str, Any]) -> Mapping[str, Any]:
    asked, before = result.asked, first.get("last_incident")
    told = come_back(asked, lambda told: told["last_incident"] != before and told["incident"] is None, BACK_S)
    if told["last_incident"] == before:
        result.fail(asked.words("drill_untold", next=next_words(told, asked.lang)))
    return told_incident(asked, str(told["last_incident"]))


def _is_relieved(result: Result, first: Mapping[str, Any], seconds: int) -> None:
    """Wait until another core has taken over from the one that leaks, or for as long as it leaks, and say what was seen."""
    asked, before, most = result.asked, first["last_incident"], 0

    def over(told: Mapping[str, Any]) -> bool:
        nonlocal most
        most = max(most, told["core"]["rss_bytes"] or 0)
        return told["last_incident"] != before and told["incident"] is None

    until(lambda: over(status_of(asked)), seconds + LEAK_BACK_S)
    told = status_of(asked)
    if told["last_incident"] == before:
        limit_mb = asked.ask(verb="policy")["policy"]["memory_limit_mb"]
        sentence = end_words(
            "leak_unseen", asked.lang, seconds=seconds, most_mb=most >> 20, limit_mb=limit_mb
        )
        result.end({"incident": None, "story": None, "most_bytes": most}, sentence, ok=False)
    story = told_incident(asked, str(told["last_incident"]))
    kept = story["diagnosis"] in LEAKS and (story["planned"], story["outcome"]) == (True, "recovered")
    sentence = end_words(
        "leak_kept" if kept else "leak_other", asked.lang, incident=story["id"], summary=story["summary"]
    )
    promised = structs.asdict(PROMISES["leak"])
    result.end({"incident": story["id"], "promised": promised, "story": story}, sentence, ok=kept)


def _goes_on(result: Result, first: Mapping[str, Any]) -> None:
    """Wait until the part has been begun anew; the core must be the same all the while."""
    asked, promise = result.asked, PROMISES["stall"]
    story = _story_after(result, first)
    same = status_of(asked)["core"]["pid"] == first["core"]["pid"]
    kept = same and (story["diagnosis"], story["outcome"]) == (promise.diagnosis, promise.outcome)
    sentence = end_words(
        "stall_kept" if kept else "stall_other", asked.lang, incident=story["id"], summary=story["summary"]
    )
    result.end(
        {"incident": story["id"], "promised": structs.asdict(promise), "story": story}, sentence, ok=kept
    )


def _is_set_aside(result: Result, first: Mapping[str, Any], key: str) -> None:
    """Send the request that is armed, wait for its verdict, and send it once more: it must be refused by its letter."""
    asked, promise = result.asked, PROMISES[result.fault]
    _send(asked, key)
    story = _story_after(result, first)
    name = hashlib.sha256(key.encode()).hexdigest()[:NAME_DIGITS]
    letter = ""

    def ruled() -> bool:
        nonlocal letter
        rules = asked.ask(verb="quarantine")["quarantine"]["rules"]
        letter = next((str(rule["id"]) for rule in rules if rule.get("name") == name), "")
        return bool(letter)

    until(ruled, BACK_S)
    status = _send(asked, key)
    story = told_incident(asked, str(story["id"]))  # what came of its trial has been added to it
    deaths = len(story["deaths"])
    as_promised = (story["diagnosis"], story["outcome"]) == (promise.diagnosis, promise.outcome)
    kept = as_promised and deaths == 1 and bool(letter) and status == SET_ASIDE
    sentence = end_words(
        "poison_kept" if kept else "poison_other",
        asked.lang,
        letter=letter or end_words("none", asked.lang),
        incident=story["id"],
        summary=story["summary"],
        deaths=deaths,
        status=status or end_words("none", asked.lang),
    )
    told = {
        "incident": story["id"],
        "letter": letter or None,
        "promised": structs.asdict(promise),
        "story": story,
    }
    result.end({**told, "status": status}, sentence, ok=kept)


def _send(asked: Asked, key: str) -> int | None:
    """Send the request of the drill; return what it was answered, None if nobody did."""
    # The key is its body too: else each drill would have the digest of the first, which was set aside.
    try:
        answer = ask(
            asked.folders.gateway,
            "POST",
            "/api/ledger/drill",
            key.encode(),
            {"Idempotency-Key": key},
            SENT_S,
        )
    except (OSError, http.client.HTTPException):
        return None
    return answer.status


def _restores(result: Result) -> None:
    """Have the ledger restored into a folder that is thrown away, by a process of its own."""
    asked = result.asked
    argv = [
        sys.executable,
        "-I",
        "-m",
        "core",
        "rehearse-restore",
        "--data",
        str(asked.folders.data),
        "--json",
    ]
    done = subprocess.run(argv, capture_output=True, text=True, check=False)
    try:
        found = json.loads(done.stdout)
    except ValueError:
        found = {}
    ok = done.returncode == 0
    why = str(found.get("reason") or (done.stderr.strip().splitlines() or [""])[-1])
    sentence = end_words("restore_kept" if ok else "restore_other", asked.lang, why=why)
    result.end({"incident": None, "story": None, "restore": found}, sentence, ok=ok)


def way_back(story: Mapping[str, Any]) -> str:
    """Return the name of the text that says who serves since: the spare, a core that was started, or the same one."""
    steps = {step["step"] for step in story["timeline"]}
    if "spawned" in steps:  # also after a spare that took over and failed
        return "back_by_start"
    return "back_by_spare" if "promoted" in steps else "back_by_itself"


def noticed(asked: Asked, detected_ms: float | None) -> str:
    """Return when a fault was noticed, in words: one that the core tells itself is known as soon as it is there."""
    if detected_ms is None:
        return asked.words("noticed_untold")
    if detected_ms < AT_ONCE_MS:
        return asked.words("noticed_at_once")
    return asked.words("noticed_after", ms=f"{detected_ms:.1f}")


def _stays_calm(result: Result, before: object) -> None:
    """Watch for a while; the drill has failed if anything was done to the core."""
    asked = result.asked
    core = status_of(asked)["core"]["pid"]
    give_up_at = time.monotonic() + PEACE_S
    while time.monotonic() < give_up_at:
        told = status_of(asked)
        if told["core"]["pid"] != core or told["last_incident"] != before:
            result.fail(asked.words("drill_disturbed"))
        time.sleep(LOOK_EVERY_S)
    result.end({"incident": None, "story": None}, asked.words("drill_calm"), ok=True)


def _another_waits(result: Result, first: Mapping[str, Any]) -> None:
    """Watch until another spare is ready; the drill has failed if none comes, or anything was done to the core."""
    asked, began = result.asked, time.monotonic()

    def waits(told: Mapping[str, Any]) -> bool:
        if told["core"]["pid"] != first["core"]["pid"] or told["last_incident"] != first["last_incident"]:
            result.fail(asked.words("drill_disturbed"))
        if told["spare_lack"] is not None:
            why = spare_lack(told["spare_lack"], asked.lang, told["spare_off"])
            result.fail(asked.words("drill_spareless", why=why))
        spare = told["spare"]
        return bool(spare and spare["ready"] and spare["pid"] != first["spare"]["pid"])

    told = come_back(asked, waits, SPARE_S)
    sentence = asked.words("drill_spared", seconds=f"{time.monotonic() - began:.1f}")
    result.end({"incident": None, "story": None, "spare": told["spare"]["pid"]}, sentence, ok=True)


def _another_accepts(result: Result, first: Mapping[str, Any]) -> None:
    """Wait until another gateway has answered and its predecessor's loss is told; the core must not have changed."""
    asked, promise = result.asked, PROMISES[result.fault]
    before = first["gateway"]["last_incident"]
    told = come_back(asked, lambda told: told["gateway"]["last_incident"] != before, BACK_S)
    lost = told["gateway"]["last_incident"]
    if lost == before or told["core"]["pid"] != first["core"]["pid"]:
        result.fail(end_words("gateway_other", asked.lang))
    story = told_incident(asked, str(lost))
    as_promised = (story["diagnosis"], story["outcome"]) == (promise.diagnosis, promise.outcome)
    sentence = end_words(
        "gateway_kept" if as_promised else "gateway_other",
        asked.lang,
        ms=f"{story['outage_ms'] or 0:.0f}",
        incident=story["id"],
    )
    told_whole = {"incident": story["id"], "promised": structs.asdict(promise), "story": story}
    result.end(told_whole, sentence, ok=as_promised)


def _another_watches(result: Result, first: Mapping[str, Any]) -> None:
    """Watch until another guard has taken over and told of it; the drill has failed if the core or the gateway changed."""
    asked, began, promise = result.asked, time.monotonic(), Promise("SENTINEL_LOST")
    watched_s = 0.0

    def told_of(told: Mapping[str, Any]) -> bool:
        nonlocal watched_s
        if told["sentinel"]["pid"] in {None, first["sentinel"]["pid"]}:
            return False
        watched_s = watched_s or time.monotonic() - began
        over = told["last_incident"] != first["last_incident"] and told["incident"] is None
        return over and told["gateway"]["pid"] is not None

    told = come_back(asked, told_of, BACK_S)
    same = all(told[who]["pid"] == first[who]["pid"] for who in ("core", "gateway"))
    if told["last_incident"] == first["last_incident"] or not same:
        result.fail(end_words("sentinel_other", asked.lang))
    story = told_incident(asked, str(told["last_incident"]))
    kept = (story["diagnosis"], story["outcome"]) == (promise.diagnosis, promise.outcome)
    sentence = end_words(
        "sentinel_kept" if kept else "sentinel_other",
        asked.lang,
        seconds=f"{watched_s:.1f}",
        incident=story["id"],
    )
    told_whole = {"incident": story["id"], "promised": structs.asdict(promise), "story": story}
    result.end({**told_whole, "watched_again_s": round(watched_s, 3)}, sentence, ok=kept)
