"""The demo: a ledger with a year in it, guarded, and a page whose buttons break it: `make demo`.

It is the ordinary program with `--demo`, in a data folder of its own, and the household of `sample_household`
sent in through its door once it answers. A core that is broken for fun again and again would soon be left alone
by a careful guard, so a folder without a policy of its own gets the demo's. This room starts it, waits, prints where to look, and stays until it
ends; Ctrl-C reaches the whole foreground group, so the guard stops everything by itself.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import time
from datetime import datetime
from pathlib import Path
from typing import Any, Final
from urllib.parse import urlsplit

from examples.guarded import HARDCORE, START_S
from examples.line import Line
from examples.sample_household import RefusedError, book, household, spoken

LOOK_EVERY_S: Final = 0.1
POLICY: Final = Path(__file__).with_name("demo_policy.json")
STATUS_S: Final = 10.0

#: What is printed when all is ready, in the language of the terminal.
READY: Final = {
    "ko": "한 해의 가계부가 들어 있어요 ({count}건).\n  가계부      {url}\n  망가뜨리기  {url}/__hc/demo\n{patience}Ctrl-C로 끝내요. 자료는 {data} 폴더에 있어요.",
    "en": "A year is in it ({count} requests).\n  The ledger  {url}\n  Break it    {url}/__hc/demo\n{patience}Ctrl-C ends it. Its data stay in {data}.",
}

#: Said if the demo's policy is in force.
PATIENCE: Final = {
    "ko": "마음껏 망가뜨려도 돼요. 다시 켜는 횟수의 한도를 크게 두었어요 (failover_policy.json).\n",
    "en": "Break it as often as you like: its limit of restarts is set high (failover_policy.json).\n",
}


def main() -> int:
    """Start, fill, wait. Returns the exit code of `hardcore up`."""
    parser = argparse.ArgumentParser(
        prog="demo", description="A sample household, and a page that breaks it."
    )
    parser.add_argument("--data", type=Path, default=Path("var/demo"), help="a data folder of its own")
    parser.add_argument("--port", type=int, default=3000, help="0: any free one")
    parser.add_argument("--lang", choices=("ko", "en"), default=spoken(os.environ))
    asked = parser.parse_args()
    argv = [str(HARDCORE), "--data", str(asked.data), "up", "--demo", "--port", str(asked.port)]
    if not (asked.data / "failover_policy.json").exists():
        argv += ["--policy", str(POLICY)]
    up = subprocess.Popen(argv, stdin=subprocess.DEVNULL)
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # it reaches `up` too, which decides
    signal.signal(signal.SIGTERM, lambda *_: up.send_signal(signal.SIGTERM))
    _fill(up, asked.data, asked.lang)
    return up.wait()


def _fill(up: "subprocess.Popen[bytes]", data: Path, lang: str) -> None:
    """Book the household once the ledger answers, and say where to look."""
    url = _ready_at(up, data)
    if url is None:
        return
    where = urlsplit(url)
    assert where.hostname is not None, "the guard tells whole addresses"
    today = datetime.now().astimezone().date()
    try:
        with Line((where.hostname, where.port or 80)) as line:
            count = book(line, household(today, lang))
    except RefusedError as error:
        print(error, file=sys.stderr, flush=True)
        return
    is_ours = (data / "failover_policy.json").read_bytes() == POLICY.read_bytes()
    patience = PATIENCE[lang] if is_ours else ""
    print(READY[lang].format(count=count, url=url, data=data, patience=patience), flush=True)


def _ready_at(up: "subprocess.Popen[bytes]", data: Path) -> str | None:
    """Wait until a core serves; return its address, or None if there will be none."""
    give_up_at = time.monotonic() + START_S
    while up.poll() is None and time.monotonic() < give_up_at:
        told = _status(data)
        # What runs there already, and is somebody's own, has another launcher.
        if told.get("url") and told["core"]["ready"] and told["launcher"]["pid"] == up.pid:
            return str(told["url"])
        time.sleep(LOOK_EVERY_S)
    return None


def _status(data: Path) -> dict[str, Any]:
    argv = [str(HARDCORE), "--data", str(data), "--json", "status"]
    done = subprocess.run(argv, capture_output=True, text=True, timeout=STATUS_S, check=False)
    told: dict[str, Any] = json.loads(done.stdout or "{}")
    return told


if __name__ == "__main__":
    sys.exit(main())
