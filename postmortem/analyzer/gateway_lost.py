"""Rule: why the gateway was lost.

The core's rules read the core's evidence and have nothing to say here. What is certain is what the kernel said (a signal,
a code, a process that stood still before anybody touched it). What a gateway was reading when it died is a suspicion
after two deaths, and no more than that: the finding names the path by its hash and says what was done about it.
"""

import signal

from postmortem.analyzer.case import Case, Confidence, Finding, loop_thread
from postmortem.incident import mapping, mappings, number, text, texts

_STOPPED = "FROZEN"
_DIED = "died"


def examine(case: Case) -> list[Finding]:
    """Name what ended the gateway, or how it stood still, and the paths that it may have died over."""
    if case.incident.diagnosis != "GATEWAY_LOST":
        return []
    ended = text(case.gateway.get("ended"))
    if ended == _DIED:
        return [_death(case), *_poison(case)]
    if ended == _STOPPED:
        state = text(mapping(case.gateway.get("last_sample")).get("state"))
        evidence = (f"the kernel's letter for it, before anybody touched it: {state or 'unknown'}",)
        return [Finding("gateway_frozen", Confidence.CERTAIN, {}, evidence)]
    return [_hang(case, ended)] if ended else [Finding("gateway_untold", Confidence.UNKNOWN, {}, ())]


def _death(case: Case) -> Finding:
    how = mapping(case.gateway.get("exit"))
    fatal, code = number(how.get("signal")), number(how.get("code"))
    kills = number(case.gateway.get("oom_kills")) or 0
    if fatal == signal.SIGKILL and kills:
        evidence = (f"exit status: signal {fatal}", f"kills for want of memory meanwhile: {kills}")
        return Finding("gateway_out_of_memory", Confidence.LIKELY, {}, evidence)
    if fatal == signal.SIGKILL:
        evidence = (f"exit status: signal {fatal}", "the guard had sent no SIGKILL")
        return Finding("gateway_killed", Confidence.CERTAIN, {}, evidence)
    if fatal is not None:
        name = _name(fatal)
        return Finding("gateway_crashed", Confidence.CERTAIN, {"signal": name}, (f"exit status: {name}",))
    if code is not None:
        return Finding("gateway_exited", Confidence.CERTAIN, {"code": str(code)}, (f"exit status: {code}",))
    return Finding("gateway_untold", Confidence.UNKNOWN, {}, ("exit status: nobody could read it",))


def _poison(case: Case) -> list[Finding]:
    """Name the paths that are refused since this death: two gateways died while they read them."""
    parsing = [one for one in mappings(case.gateway.get("requests")) if one.get("stage") == "PARSING"]
    known = {text(one.get("path_hash")) for one in parsing}
    return [
        Finding(
            "gateway_poison",
            Confidence.LIKELY,
            {"path": name},
            (f"path {name} was being read in two deaths; requests being read in this one: {len(parsing)}",),
        )
        for name in texts(case.gateway.get("refused_paths"))
        if name in known
    ]


def _hang(case: Case, ended: str) -> Finding:
    loop = loop_thread(case)
    if loop is None or not loop.frames:
        return Finding("gateway_hung", Confidence.LIKELY, {}, (f"it was judged {ended}",))
    frame = loop.frames[0]
    values = {"function": frame.function, "place": frame.place}
    evidence = (f"it was judged {ended}", f"its loop stood in {frame.function} ({frame.place})")
    return Finding("gateway_hung_in", Confidence.LIKELY, values, evidence)


def _name(number_: int) -> str:
    try:
        return signal.Signals(number_).name
    except ValueError:
        return f"signal {number_}"
