"""A core as a new guard may find one: `python -m tests.contract.found_core STATE EPOCH SAYS`.

It owns the page that its environment names, as a core does, and answers on its control socket what it is told to:
`well`, `safe`, `obeying` (a person wants reads only), or nothing at all (`mute`). It never ends by itself.
"""

import os
import socket
import sys
from pathlib import Path

from core.guarded.recorder import LifeState, Recorder

ANSWERS = {
    "well": b'{"ok": true, "safe": null}\n',
    "safe": b'{"ok": true, "safe": "DISK_FULL"}\n',
    "obeying": b'{"ok": true, "safe": "OPERATOR"}\n',
    "mute": b"",
}


def bound(path: str) -> socket.socket:
    made = socket.socket(socket.AF_UNIX)
    made.bind(path)
    made.listen()
    return made


def run(state: LifeState, epoch: int, says: str) -> None:
    served = bound(os.environ["HARDCORE_SOCKET"])
    control = bound(os.environ["HARDCORE_CONTROL"])
    recorder = Recorder.open(Path(os.environ["HARDCORE_RECORDER"]))
    assert isinstance(recorder, Recorder), recorder
    recorder.set_epoch(epoch)
    recorder.set_state(state)
    sys.stdout.write("there\n")
    sys.stdout.flush()
    kept = []  # a client whose connection was closed would know more than one that is left alone
    while True:
        client, _address = control.accept()
        client.recv(4096)
        client.sendall(ANSWERS[says])
        kept.append((client, served))


if __name__ == "__main__":
    run(LifeState[sys.argv[1]], int(sys.argv[2]), sys.argv[3])
