"""What two policies say otherwise, by the names of what differs.

Compared is what they mean in full: a number that one of them names and that is its default in the other differs in
nothing, and neither does a list of words in another order.
"""

from collections.abc import Mapping

from hardcore.recovery.policy import Policy, in_full


def differences(old: Policy, new: Policy) -> list[str]:
    """Return the names of what two policies say otherwise, as `actions.FROZEN` or `gateway.hold_ms` where it is inside."""
    before, after = flat(in_full(old)), flat(in_full(new))
    names = [name for name in after if before.get(name) != after[name]]
    return names if old.alerts == new.alerts else [*names, "alerts"]


def flat(told: Mapping[str, object]) -> dict[str, object]:
    """Return what `in_full` says without objects inside: `actions.FROZEN`, `gateway.hold_ms`."""
    flat: dict[str, object] = {}
    for name, value in told.items():
        if isinstance(value, dict):
            flat |= {f"{name}.{inner}": one for inner, one in value.items()}
        else:
            flat[name] = value
    return flat
