"""A block of runs on one house, from its start to its end."""

import random
import shutil
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, Final

from tests.campaign.audit import Audit, bystander, dismiss
from tests.campaign.run import Runs, Told
from tests.integration.house import WITH_SPARE, House

#: Runs that one house goes through.
BLOCK: Final = 20
#: Of these a guard answers with a start; more, and it waits for a person.
BUDGET: Final[dict[str, Any]] = {"max_restart_count": 8, "restart_window_sec": 20}


def carry_out(
    seeds: Iterable[int], say: Callable[[Told], None] = lambda _: None, keep: Path | None = None
) -> list[Told]:
    """Carry out these seeds, one after the other, on one house; a house whose law broke is replaced.

    `keep`: where the logs and the incidents of such a house are left, by the seed.
    """
    told: list[Told] = []
    left = list(seeds)
    while left:
        folder = Path(tempfile.mkdtemp(prefix="campaign-"))
        spare = WITH_SPARE if random.Random(left[0]).random() < 0.7 else {}
        house, stranger = House(folder / "data", {**BUDGET, **spare}), bystander()
        try:
            house.up()
            house.open_accounts()
            runs = Runs(house, Audit(house, stranger))
            while left and not (runs.done and runs.done[-1].broken):
                say(runs.run(left.pop(0)))
                if keep is not None and runs.done[-1].broken:
                    _keep(house, keep / str(runs.done[-1].seed))
            told += runs.done
        finally:
            dismiss(stranger)
            house.end()
            shutil.rmtree(folder, ignore_errors=True)
    return told


def _keep(house: House, place: Path) -> None:
    for folder in (house.folders.logs, house.folders.incidents):
        shutil.copytree(folder, place / folder.name, dirs_exist_ok=True)
