"""The page of the policy: what the guard goes by, in plain words, what is wrong with its file, and reading it again.

What is in force is asked of the guard, because its file may be faulty or `up` may have been given another mode. Changing
it is the file's business: whoever has this page open has not signed in.
"""

from collections.abc import Mapping
from typing import Any, Final

from starlette.requests import Request
from starlette.responses import Response

from frontend.admin_paper import knows
from postmortem.incident import mapping, text
from postmortem.web.lobby import Lobby, lead_to, words_of

POLICY_FILE: Final = "failover_policy.json"
SETTINGS_MAX: Final = 200
DIAGNOSES_MAX: Final = 64
WORDS_MAX: Final = 12
_HERE: Final = "/admin/policy"


async def policy(lobby: Lobby, request: Request) -> Response:
    """GET /admin/policy."""
    answer = mapping(await lobby.places.ask_guard({"verb": "policy"}))
    told = mapping(answer.get("policy"))
    words = words_of(request)
    mode = text(told.get("mode"))
    return lobby.show(
        request,
        "policy.html.j2",
        _HERE,
        away=not told,
        mode=mode if knows(f"mode_{mode}") else "act",
        fault=text(answer.get("fault")),
        path=str(lobby.places.data / POLICY_FILE),
        settings=_settings(told, words),
        actions=_actions(mapping(told.get("actions")), words),
    )


async def reload(lobby: Lobby, request: Request) -> Response:
    """POST /admin/policy/reload: read the file now; a faulty one changes nothing, so nothing has to be asked first."""
    form = await lobby.form(request)
    if isinstance(form, Response):
        return form
    told = await lobby.places.ask_guard({"verb": "policy-reload"})
    if told is None:
        outcome, code = "guard away", "guard_away"
    elif told.get("ok") is True:
        outcome, code = "read", "policy_read"
    else:
        faulty = told.get("code") == "policy-faults"
        outcome, code = ("faulty", "policy_faulty") if faulty else ("refused", "guard_refused")
    await lobby.places.write_down("policy-reload", "policy", "", outcome)
    return lead_to(_HERE, code)


def _settings(told: Mapping[str, Any], words: Any) -> list[tuple[str, str, str]]:
    """Return each setting: name, value, what it means; of the gateway's, which have no words here, name and value."""
    shown = []
    for name, value in list(told.items())[:SETTINGS_MAX]:
        if isinstance(value, Mapping):
            continue
        means = words(f"set_{name}") if knows(f"set_{name}") else ""
        shown.append((name, _value(value), means))
    limits = mapping(told.get("gateway"))
    return shown + [
        (f"gateway.{name}", _value(value), "") for name, value in list(limits.items())[:SETTINGS_MAX]
    ]


def _value(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, list):
        return ", ".join(str(one) for one in value[:WORDS_MAX])
    return str(value)


def _actions(told: Mapping[str, Any], words: Any) -> list[tuple[str, str]]:
    """Return what is done on each diagnosis, in words."""
    shown = []
    for name, asked in list(told.items())[:DIAGNOSES_MAX]:
        given = asked[:WORDS_MAX] if isinstance(asked, list) else []
        deeds = [words(f"word_{one}") if knows(f"word_{one}") else str(one) for one in given]
        shown.append((str(name), " · ".join(deeds)))
    return shown
