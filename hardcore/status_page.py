"""The status for people: a few aligned lines, the next step where one is needed."""

from typing import Any

from frontend.catalogue import label, next_step, spare_lack, state_words
from frontend.catalogue_evidence import in_korean
from frontend.catalogue_policy import diagnosis_words
from hardcore.lines import cells, wrapped
from hardcore.model.phases import Phase, Wanted
from hardcore.model.verdicts import Diagnosis

#: A core serves and has proven itself; a worry is no reason to wait.
PROVEN = frozenset({Phase.RUNNING, Phase.SUSPECT})
#: What could not be done, by the names of the status; each has a label.
FAULTS = ("start_fault", "switch_fault")
#: Of somebody's last words so many characters are shown; all of them stand in the log.
WORDS_MAX = 160


def printed_status(told: dict[str, Any], lang: str) -> str:
    """Return the status as lines of a terminal."""
    rows = [("state", _state(told, lang))]
    if told["mode"] != "act":
        rows.append(("mode", label(f"mode_{told['mode']}", lang)))
    if told["policy_fault"]:
        rows.append(("policy_fault", _why(told["policy_fault"], lang)))
    rows += _safe(told, lang)
    if told["state"] == "MANUAL_INTERVENTION" or told["safe"]:
        rows.append(("next", next_step(told.get("waits_for") or told["safe"], lang)))
    none = label("none", lang)
    rows.append(("address", told["url"] or none))
    rows.append(("core", _core(told["core"], lang)))
    sentinel = told["sentinel"]
    if told["core"]["pid"] and told["core"]["old_pid"]:
        rows.append(("behind", f"pid {told['core']['old_pid']}, {label('behind_fence', lang)}"))
    if sentinel["pid"]:
        rows.append(("spare", _spare(told, lang)))
    if told["switch_waits"]:
        rows.append(("switch", label("switch_waits", lang)))
    rows += [(name, _why(told[name], lang)) for name in FAULTS if told[name]]
    rows.append(("gateway", _gateway(told["gateway"], lang)))
    if sentinel["pid"]:
        cpu = "-" if sentinel["cpu_percent"] is None else f"{sentinel['cpu_percent']} %"
        rows.append(("sentinel", f"pid {sentinel['pid']}, {cpu}, {sentinel['rss_bytes'] // (1 << 20)} MB"))
        rows.append(("budget", label("budget_used", lang).format(**told["budget"])))
    rows.append(("incident", told["incident"] or none))
    rows.append(("last_incident", told["last_incident"] or none))
    if told["dead_letters"]:
        rows.append(("dead_letters", label("dead_letters_aside", lang).format(count=told["dead_letters"])))
    rows.append(("verified", told["ledger_verified_at"] or none))
    kept = told["backup"]
    rows.append(("backup", label("backup_kept", lang).format(**kept) if kept["made_at"] else none))
    estimate = told.get("estimate", {})
    if estimate.get("samples"):
        key = "estimate_score" if estimate["scored"] else "estimate_none"
        rows.append(("estimate", label(key, lang).format(**estimate)))
    rows += [("part", label("part_silent", lang).format(**each)) for each in _silent(told)]
    rows += [("forecast", _why(each["why"], lang)) for each in told["forecasts"]]
    rows += [("worry", _why(worry, lang)) for worry in told.get("worries", [])]
    names = [label(key, lang) for key, _value in rows]
    width = max(cells(name) for name in names)
    lines = zip(names, rows, strict=True)
    return "\n".join(
        f"{name}{' ' * (width - cells(name))}  {wrapped(str(value), width + 2)}"
        for name, (_key, value) in lines
    )


def _safe(told: dict[str, Any], lang: str) -> list[tuple[str, str]]:
    """Return who has it read only, and why."""
    if told["wanted"] == Wanted.SAFE:
        reason = f" · {_why(told['safe_reason'], lang)}" if told["safe_reason"] else ""
        rows = [("safe_by", label("safe_by_operator", lang) + reason)]
    else:
        rows = []
    if told["safe"] and told["safe"] != Diagnosis.OPERATOR:
        rows.append(("safe", f"{diagnosis_words(told['safe'], lang)} ({told['safe']})"))
    return rows


def _silent(told: dict[str, Any]) -> list[dict[str, Any]]:
    """Return the parts of the core that have work and give no sign for longer than they may."""
    return [
        {"name": each["name"], "age_ms": each["beat_age_ms"], "limit_ms": each["limit_ms"]}
        for each in told["components"]
        if each["beat_age_ms"] is not None and each["limit_ms"] and each["beat_age_ms"] > each["limit_ms"]
    ]


def _state(told: dict[str, Any], lang: str) -> str:
    if told["state"] == "UNKNOWN" and told["wanted"] == "DOWN":
        return label("stopped", lang)
    return f"{state_words(told['state'], lang)} ({told['state']}, {told['phase'] or '-'})"


def _core(core: dict[str, Any], lang: str) -> str:
    if not core["pid"]:
        return label("none", lang)
    age = core["heartbeat_age_ms"]
    beat = "" if age is None else f", {label('beat', lang)} {age} ms"
    epoch = f"{label('epoch', lang)} {core['epoch']}"
    return f"pid {core['pid']}, {epoch}{beat}, {label('in_flight', lang)} {core['in_flight']}"


def _spare(told: dict[str, Any], lang: str) -> str:
    spare = told["spare"]
    if spare is None:
        lack = told["spare_lack"]
        if lack:
            return spare_lack(lack, lang, _why(told["spare_off"], lang))
        return label("spare_soon" if told["phase"] in PROVEN else "spare_later", lang)
    ready = label("spare_ready" if spare["ready"] else "spare_starting", lang)
    outdated = f", {label('spare_outdated', lang)}" if spare["build_fits"] is False else ""
    return f"pid {spare['pid']}, {ready}{outdated}"


def _why(words: str, lang: str) -> str:
    """Return the guard's own words in a language; of last words, which may be a whole traceback, the beginning."""
    words = in_korean(words) if lang == "ko" else words
    return words if len(words) <= WORDS_MAX else f"{words[: WORDS_MAX - 1]}…"


def _gateway(gateway: dict[str, Any], lang: str) -> str:
    if not gateway["pid"]:
        return label("none", lang)
    return f"pid {gateway['pid']}, {label('held', lang)} {gateway['held_requests']}"
