"""Draws `docs/policy.md` from the declarations, so that the manual can't fall behind them.

`python -m tests.architecture.draw_policy` writes it anew; a test holds the file against this text.
"""

import dataclasses
import json
from pathlib import Path

from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.policy import DEFAULT_ACTIONS, Policy
from hardcore.settings import Limits

PAGE = Path(__file__).parents[2] / "docs" / "policy.md"

_HEAD = """# The failover policy

`DATA/failover_policy.json` says what is done on which diagnosis and carries every number of the watch. A first
start writes it with the defaults. A file may name only what differs. `hardcore policy check FILE` tells
everything that is wrong with one, with line and reason; `hardcore up --policy FILE` checks it and puts it into
DATA. A bad file never replaces a good one: if the file in DATA is faulty, the last good one stays in force, and status,
dashboard and an alert say so until it is mended.

A running guard looks at the file once a second and takes a changed one whole or not at all; `hardcore policy reload` does it
at once and says what changed, and what of it holds from the next core or gateway on (what those were told when they were
started). `hardcore policy explain DIAGNOSIS` says in sentences what would be done, `hardcore policy dry-run FILE` what another
policy would have done in the incidents that were recorded.

This page is drawn from the declarations (`python -m tests.architecture.draw_policy`).

## Numbers of the watch

"""

_BETWEEN = """
`on_await_timeout` names one thing to do at most beside SEND_ALERT; `enable_leader_election` can only be false.
Between the numbers: `health_check_timeout_ms` is at least `health_check_interval_ms` × `failure_threshold`;
`confirm_deadlock_ms` is more than `health_check_timeout_ms`; `confirm_hang_ms` is at least
`confirm_deadlock_ms`; `backoff_max_ms` is at least `backoff_initial_ms`; `transaction_timeout_ms` is more than
`health_check_timeout_ms`.

## Who is told

`"alerts": [{"kind": "ntfy", "url": "https://ntfy.example.org/our-ledger", "min_interval_s": 1800}]`: at most 8 channels of
the kinds webhook, ntfy, smtp and apprise, with `name`, `lang` (ko, en; without it both), `quiet_hours` ("22:00-07:00", local
time) and `secret_file` (a whole path) if you like. `hardcore alerts test` tries them. Their addresses are never shown.

## The gateway

An object `"gateway"` of what differs:

"""

_ACTIONS = """
## What is done on a diagnosis

`"actions": {"FROZEN": ["SEND_ALERT", "SNAPSHOT", "REBOOT_PROCESS"]}`. The list is a set; the order of the
steps is always the same: tell, evidence, kill, restart, proof. REBOOT_PROCESS restarts the core,
AWAIT_OPERATOR leaves it down and waits for `hardcore resume`, SHUTDOWN stops it until then, SNAPSHOT takes the evidence,
SEND_ALERT tells the channels of `alerts`, RESTART_COMPONENT starts one stalled part anew, PLANNED_SWITCH has the spare take
over in a quiet moment, NONE does nothing. SAFE_MODE_ENTER has the core serve reads
only: a living one is told to, and one that can't start is started so. For a disk's reasons a try to write again
is made after `safe_retry_ms`, then at doubling pauses up to a minute, and for a lock of another program's when it is
free; any other reason waits for `hardcore resume`. DEGRADE keeps the core, shows DEGRADED and tells an incident that
lasts as long as its cause. A living core is ended only on a diagnosis whose list says REBOOT_PROCESS; one that hangs
and is given none of REBOOT_PROCESS and DEGRADE is left as it is, and the state is MANUAL_INTERVENTION.

A core that is to begin and can't reach its database's server (STORE_AWAY) is tried again for as long as that lasts, at the same
pauses and outside the budget, whatever its list says beside SEND_ALERT and SNAPSHOT: without it there is nothing to read.
A core that meets another program's lock at its start (DB_LOCKED) is started again for as long as the lock lasts, at
pauses of up to `backoff_max_ms` and outside the budget, unless its list says AWAIT_OPERATOR; with DEGRADE or
SAFE_MODE_ENTER reads are served meanwhile.

What can't be done is refused: SAFE_MODE_ENTER on a hang (a core that hangs obeys no order), SHUTDOWN on anything of a
living core (it keeps a dead one down), DEGRADE on a death, REBOOT_PROCESS on CRASH_LOOP, anything but NONE on STARVED
and SLEPT, RESTART_COMPONENT on anything but COMPONENT_STALLED, PLANNED_SWITCH where the core does not answer, more than
telling and PLANNED_SWITCH on a forecast (MEMORY_PRESSURE, LEAK, FD_EXHAUSTION), and leaving the core down on OPERATOR and SENTINEL_LOST. STORE_CORRUPT can't be given REBOOT_PROCESS: a ledger
that may be damaged is never put back to work by itself.

| Diagnosis | By default |
|---|---|
"""


def _rows(cls: type[Policy] | type[Limits]) -> list[str]:
    rows = ["| Setting | Default | Range | Meaning |", "|---|---|---|---|"]
    for field in dataclasses.fields(cls):
        if "text" not in field.metadata:
            continue
        meta, default = field.metadata, field.default
        shown = str(default).lower() if isinstance(default, bool) else str(default)
        if isinstance(default, tuple):
            shown = json.dumps(default)
        if meta["words"]:
            span = ("a list of " if isinstance(default, tuple) else "") + ", ".join(meta["words"])
        elif isinstance(default, bool):
            span = "true, false"
        else:
            span = f"{meta['low']} to {meta['high']}"
        rows.append(f"| `{field.name}` | {shown} | {span} | {meta['text']} |")
    return rows


def draw() -> str:
    """Return the whole page."""
    actions = [
        f"| {diagnosis} | {', '.join(sorted(DEFAULT_ACTIONS[diagnosis]))} |" for diagnosis in Diagnosis
    ]
    return "".join(
        (
            _HEAD,
            "\n".join(_rows(Policy)),
            "\n",
            _BETWEEN,
            "\n".join(_rows(Limits)),
            "\n",
            _ACTIONS,
            "\n".join(actions),
            "\n",
        )
    )


if __name__ == "__main__":
    PAGE.write_text(draw(), encoding="utf-8")
