"""What the guard keeps on disk between its lives: policy, what is wanted, generation, whose the run folder is."""

import contextlib
import dataclasses
import os
from dataclasses import dataclass
from pathlib import Path

from hardcore.executor import Bounds
from hardcore.host import clock, files, leftovers
from hardcore.host.folders import Folders
from hardcore.host.ids import new_id
from hardcore.host.lives import CoreLimits
from hardcore.model.phases import Wanted
from hardcore.recovery.policy import (
    POLICY_BYTES_MAX,
    Policy,
    PolicyFault,
    read_policy,
    shipped_text,
)
from hardcore.snapshot.image import ImageLimits

#: Passed from `hardcore up --no-spare` to each sentinel of that launcher: none keeps a spare, whatever the policy says.
NO_SPARE_SWITCH = "HARDCORE_NO_SPARE"


@dataclass(frozen=True, slots=True)
class PolicyInForce:
    """A policy, and why it is not the file's if it is not."""

    policy: Policy
    fault: str = ""


def load_policy_file(path: Path) -> Policy | list[PolicyFault]:
    """Return the policy in a file, or everything that is wrong with it."""
    try:
        if not path.is_file():
            return [PolicyFault(0, "", "is not a file that can be read")]
        with path.open("rb") as file:
            data = file.read(POLICY_BYTES_MAX + 1)
        if len(data) > POLICY_BYTES_MAX:
            return [PolicyFault(0, "", f"larger than {POLICY_BYTES_MAX} bytes")]
        return read_policy(data.decode("utf-8-sig"))
    except UnicodeDecodeError:
        return [PolicyFault(0, "", "not UTF-8 text")]
    except OSError as error:
        return [PolicyFault(0, "", f"can't be read: {error.strerror}")]


def policy_in_force(folders: Folders) -> PolicyInForce:
    """Return the policy of the data folder, less what the command line has taken away."""
    found = policy_at_next_start(folders)
    if os.environ.get(NO_SPARE_SWITCH) == "1":
        return PolicyInForce(dataclasses.replace(found.policy, spare=False), found.fault)
    return found


def policy_at_next_start(folders: Folders) -> PolicyInForce:
    """Return the policy that a guard would begin with; a bad file never replaces the last good one."""
    found = load_policy_file(folders.policy)
    if isinstance(found, Policy):
        return PolicyInForce(found)
    fault = f"{folders.policy.name}: {found[0]}"
    kept = load_policy_file(folders.good_policy)
    if isinstance(kept, Policy):
        return PolicyInForce(kept, f"{fault}; the last good policy stays in force")
    return PolicyInForce(Policy(), f"{fault}; the defaults are in force")


def ship_policy(folders: Folders) -> None:
    """Write the defaults where there is no policy yet."""
    if not folders.policy.exists():
        with contextlib.suppress(OSError):  # as above: the defaults hold without their file
            files.write_whole(folders.policy, shipped_text().encode())


def bounds(policy: Policy) -> Bounds:
    """Return the numbers of a policy that the hands need."""
    return Bounds(
        CoreLimits(policy.transaction_timeout_ms, policy.memory_limit_mb << 20),
        ImageLimits(policy.memory_image_budget_ms, policy.memory_image_mb_max << 20),
    )


def wanted(folders: Folders) -> Wanted:
    """Return what the operator wants; UP when nobody has said anything."""
    stored = files.read_json(folders.state / "wanted.json").get("wanted")
    return Wanted.DOWN if stored == Wanted.DOWN else Wanted.UP


def store_wanted(folders: Folders, what: Wanted) -> None:
    """Write down what the operator wants. On disk before the first signal is sent."""
    files.write_json(folders.state / "wanted.json", {"wanted": str(what), "at": clock.wall(clock.now_ns())})


def want_up(folders: Folders) -> None:
    """Write down that it should run; a disk that refuses is no hindrance where nothing else is written there."""
    try:
        store_wanted(folders, Wanted.UP)
    except OSError:
        if wanted(folders) is Wanted.DOWN:
            raise


def own_run_folder(folders: Folders) -> None:
    """Make sure that what lies in the run folder was left by this data folder; else its pages are removed.

    Its name comes from a path, and a person may remove the data at that path and begin anew: the last pages of
    the old ledger say nothing about the new one. So the data has an identity of its own, in `state/`, and the
    run folder remembers it. A ledger that vanishes or goes back while `state/` stays keeps its witness.
    The caller holds the sentinel's lock and has not taken a generation yet.
    """
    kept, noted = folders.state / "instance.json", folders.run / "instance.json"
    known, seen = (files.read_json(path).get("instance") for path in (kept, noted))
    if not known and kept.exists():
        return  # it can't be read now: in doubt the witness stays
    # Data from before there were identities: a guard has watched it, and its run folder knows no other.
    older = not known and not seen and folders.generation.exists()
    if known and seen == known:
        return
    with contextlib.suppress(OSError):  # a full disk must not keep the guard from coming back
        if not known:
            known = new_id()
            files.write_json(kept, {"instance": known})
        if not older:
            leftovers.forget_pages(folders)
        files.write_json(noted, {"instance": known}, durable=False)  # last: it says that this was done


def next_generation(folders: Folders) -> int:
    """Take the next generation number. The caller holds the sentinel's lock, and has `keep` called soon.

    Nothing waits for a disk here: where that hangs, a guard that died must be replaced all the same.
    """
    paths = (folders.generation, folders.run / "generation")
    stored = [files.read_json(path).get("generation") for path in paths]
    number = max(value if isinstance(value, int) else 0 for value in stored) + 1
    files.write_json(paths[1], {"generation": number}, durable=False)
    return number


def keep(folders: Folders, generation: int) -> None:
    """Write to the disk what this guard began with: its generation, and the policy as the last good one, if it is one.

    It may take as long as the disk likes.
    """
    with contextlib.suppress(OSError):  # a full disk must not keep the guard from coming back
        files.write_json(folders.generation, {"generation": generation})
    found = load_policy_file(folders.policy)
    if isinstance(found, Policy):
        with contextlib.suppress(OSError):  # as above
            text = folders.policy.read_bytes()
            if not folders.good_policy.exists() or folders.good_policy.read_bytes() != text:
                files.write_whole(folders.good_policy, text)
