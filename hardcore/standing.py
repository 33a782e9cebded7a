"""What the guard keeps on disk between its lives: policy, what is wanted, generation, whose the run folder is."""

import contextlib
import dataclasses
import os
from collections.abc import Sequence
from pathlib import Path
from typing import TypeGuard

import msgspec

from hardcore.bounds import Bounds
from hardcore.host import clock, files, leftovers, wish
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
#: Passed from `hardcore up --mode` in the same way: what each guard of that run may do, whatever the policy says.
MODE_SWITCH = "HARDCORE_MODE"
MODES = ("act", "assist", "observe")
REASON_CHARACTERS_MAX = 500
#: A number that is larger was written by no guard; the pages have 8 bytes for it.
GENERATION_MAX = 1 << 53


class PolicyInForce(msgspec.Struct, frozen=True):
    """A policy, and why it is not the file's if it is not."""

    policy: Policy
    fault: str = ""


def load_policy_file(path: Path) -> Policy | list[PolicyFault]:
    """Return the policy in a file, or everything that is wrong with it."""
    data = read_policy_file(path)
    return data if isinstance(data, list) else judge_policy(data)


def read_policy_file(path: Path) -> bytes | list[PolicyFault]:
    """Return what stands in a policy file, or why it can't be read."""
    try:
        if not path.is_file():
            return [PolicyFault(0, "", "is not a file that can be read")]
        with path.open("rb") as file:
            data = file.read(POLICY_BYTES_MAX + 1)
    except OSError as error:
        return [PolicyFault(0, "", f"can't be read: {error.strerror}")]
    too_long = len(data) > POLICY_BYTES_MAX
    return [PolicyFault(0, "", f"larger than {POLICY_BYTES_MAX} bytes")] if too_long else data


def judge_policy(data: bytes) -> Policy | list[PolicyFault]:
    """Return the policy that a file's bytes say, or everything that is wrong with them."""
    try:
        return read_policy(data.decode("utf-8-sig"))
    except UnicodeDecodeError:
        return [PolicyFault(0, "", "not UTF-8 text")]


def stamp_of(path: Path) -> tuple[int, ...] | None:
    """Return what changes whenever a file is written or replaced; None while there is none that can be looked at."""
    try:
        told = path.stat()
    except OSError:
        return None
    return told.st_ino, told.st_size, told.st_mtime_ns, told.st_ctime_ns


def fault_of(folders: Folders, found: Sequence[PolicyFault]) -> str:
    """Return why the policy file is not what is gone by, as one line: the first fault, and how many more there are."""
    return f"{folders.policy.name}: {first_of(found)}"


def first_of(found: Sequence[PolicyFault]) -> str:
    """Return the first of some faults, and how many more there are."""
    more = f" (and {len(found) - 1} more; `hardcore policy check` names them)" if len(found) > 1 else ""
    return f"{found[0]}{more}"


def policy_in_force(folders: Folders) -> PolicyInForce:
    """Return the policy of the data folder, as the command line of this run has it."""
    found = policy_at_next_start(folders)
    return PolicyInForce(of_this_run(found.policy), found.fault)


def of_this_run(policy: Policy) -> Policy:
    """Return a policy with what the command line has said over it: that holds for this run alone."""
    mode = os.environ.get(MODE_SWITCH, "")
    return dataclasses.replace(
        policy,
        spare=policy.spare and os.environ.get(NO_SPARE_SWITCH) != "1",
        mode=mode if mode in MODES else policy.mode,
    )


def policy_at_next_start(folders: Folders) -> PolicyInForce:
    """Return the policy that a guard would begin with; a bad file never replaces the last good one."""
    found = load_policy_file(folders.policy)
    if isinstance(found, Policy):
        return PolicyInForce(found)
    fault = fault_of(folders, found)
    kept = load_policy_file(folders.good_policy)
    if isinstance(kept, Policy):
        return PolicyInForce(kept, fault)
    return PolicyInForce(Policy(), f"{fault}; the defaults are in force")


def ship_policy(folders: Folders) -> None:
    """Write the defaults where there is no policy yet."""
    if not folders.policy.exists():
        with contextlib.suppress(OSError):  # as above: the defaults hold without their file
            files.write_whole(folders.policy, shipped_text().encode())


def bounds(policy: Policy) -> Bounds:
    """Return the numbers of a policy that the hands need."""
    return Bounds(
        CoreLimits(
            policy.transaction_timeout_ms,
            policy.memory_limit_mb << 20,
            policy.checkpoint_interval_sec,
            policy.checkpoints_kept,
            policy.checkpoint_age_hours,
            policy.enable_state_recovery,
        ),
        ImageLimits(policy.memory_image_budget_ms, policy.memory_image_mb_max << 20),
    )


def wanted(folders: Folders) -> Wanted:
    """Return what the operator wants; UP when nobody has said anything."""
    return wish.read(folders).wanted


def safe_reason(folders: Folders) -> str:
    """Return why the operator wants reads only, as it was written down; empty: no reason, or not wanted."""
    found = wish.read(folders)
    return found.reason if found.safe else ""


def store_wanted(folders: Folders, what: Wanted, reason: str = "") -> None:
    """Write down what the operator wants. On disk before the first signal is sent.

    A wish for reads only outlives a DOWN: it is written beside it, and the next `up` finds it.
    """
    kept = wish.read(folders)
    told: dict[str, object] = {"wanted": str(what), "at": clock.wall(clock.now_ns())}
    if what is Wanted.DOWN and kept.safe:
        told |= {"before": str(Wanted.SAFE), "reason": kept.reason}
    elif what is Wanted.SAFE:
        told["reason"] = reason[:REASON_CHARACTERS_MAX]
    wish.store(folders, told)


def want_safe(folders: Folders, reason: str, *, on: bool) -> bool:
    """Write down, with everything stopped, whether reads only are wanted from the next start on; return what changed.

    Raises OSError where it can't be written. What is stopped stays stopped.
    """
    kept = wish.read(folders)
    if kept.safe == on:
        return False
    if kept.wanted is not Wanted.DOWN:
        store_wanted(folders, Wanted.SAFE if on else Wanted.UP, reason)
        return True
    told: dict[str, object] = {"wanted": str(Wanted.DOWN), "at": clock.wall(clock.now_ns())}
    if on:
        told |= {"before": str(Wanted.SAFE), "reason": reason[:REASON_CHARACTERS_MAX]}
    wish.store(folders, told)
    return True


def want_up(folders: Folders) -> None:
    """Write down that it should run; one that was to serve reads only is to do that again.

    A disk that refuses is no hindrance where nothing else is written there.
    """
    kept = wish.read(folders)
    if kept.wanted is Wanted.SAFE:
        return
    try:
        store_wanted(folders, Wanted.SAFE if kept.safe else Wanted.UP, kept.reason)
    except OSError:
        if kept.wanted is Wanted.DOWN:
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
    number = max((value for value in stored if _is_generation(value)), default=0) + 1
    files.write_json(paths[1], {"generation": number}, durable=False)
    return number


def _is_generation(value: object) -> TypeGuard[int]:
    return isinstance(value, int) and not isinstance(value, bool) and 0 <= value < GENERATION_MAX


def keep(folders: Folders, generation: int) -> None:
    """Write to the disk what this guard began with: its generation, and the policy as the last good one, if it is one.

    It may take as long as the disk likes.
    """
    with contextlib.suppress(OSError):  # a full disk must not keep the guard from coming back
        files.write_json(folders.generation, {"generation": generation})
    text = read_policy_file(folders.policy)
    if isinstance(text, bytes) and isinstance(judge_policy(text), Policy):
        keep_policy(folders, text)


def keep_policy(folders: Folders, text: bytes) -> None:
    """Keep the text of a policy as the last good one, if it is not that already."""
    with contextlib.suppress(OSError):  # a full disk must not keep the guard from going by it
        if not folders.good_policy.exists() or folders.good_policy.read_bytes() != text:
            files.write_whole(folders.good_policy, text)
