"""Slots: the ids they give are nobody else's, whichever thread asks."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from core.guarded.recorder import NoRecorder
from core.rulings import Rulings
from core.settings import Settings
from core.slots import IDS_AHEAD, Slots


def test_no_two_threads_are_given_the_same_id(tmp_path: Path) -> None:
    settings = Settings.read({}, tmp_path)
    assert isinstance(settings, Settings)
    slots = Slots(NoRecorder(), settings, Rulings())
    with ThreadPoolExecutor(4) as threads:
        ids = list(threads.map(lambda _: slots.new_id(), range(8 * IDS_AHEAD)))
    assert len({one[-10:] for one in ids}) == len(ids)
