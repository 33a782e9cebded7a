"""What a campaign found, as lines for a terminal and as the table that is kept in `docs/reliability.md`."""

import statistics
from collections import Counter, defaultdict
from collections.abc import Sequence

from bench.machine import described
from tests.campaign.faults import FAULTS
from tests.campaign.run import Told


def _shares(values: Sequence[int]) -> str:
    """Return the middle, the 95th and the 99th of these, in ms."""
    if not values:
        return "-"
    ordered = sorted(values)
    at = [ordered[min(len(ordered) - 1, int(len(ordered) * share))] for share in (0.95, 0.99)]
    return f"{statistics.median(ordered):.0f} / {at[0]:.0f} / {at[1]:.0f}"


def _by_diagnosis(told: Sequence[Told]) -> dict[str, tuple[list[int], list[int]]]:
    found: dict[str, tuple[list[int], list[int]]] = defaultdict(lambda: ([], []))
    for one in told:
        for diagnosis, detected_ms, outage_ms in one.incidents:
            noticed, lasted = found[diagnosis]
            noticed += [detected_ms] if detected_ms is not None else []
            lasted += [outage_ms] if outage_ms is not None else []
    return found


def _covered(told: Sequence[Told]) -> Counter[tuple[str, str]]:
    return Counter(pair for one in told for pair in one.met)


def totals(told: Sequence[Told]) -> list[tuple[str, str]]:
    """Return the sums of a campaign, each with its name."""
    broken = [one for one in told if one.broken]
    return [
        ("runs", f"{len(told):,}"),
        ("faults that struck", f"{sum(len(one.met) for one in told):,}"),
        ("requests asked, each answered once and in the ledger once", f"{sum(one.asked for one in told):,}"),
        ("incidents, each with its report", f"{sum(len(one.incidents) for one in told):,}"),
        ("runs that waited for a person (budget spent)", f"{sum(one.manual > 0 for one in told):,}"),
        ("fault and moment met together", f"{len(_covered(told)):,} pairs"),
        ("runs in which a law broke", f"{len(broken):,}"),
    ]


def summary(told: Sequence[Told], took_s: float) -> str:
    """Return all of it for a terminal."""
    lines = [
        "",
        described(),
        *(f"{name}: {value}" for name, value in totals(told)),
        f"took {took_s:.0f} s",
        "",
    ]
    lines.append("noticed and away, ms: median / p95 / p99")
    for diagnosis, (noticed, lasted) in sorted(_by_diagnosis(told).items()):
        lines.append(f"  {diagnosis:<22}{_shares(noticed):>22}{_shares(lasted):>26}   of {len(lasted)}")
    lines += ["", "fault x moment"]
    covered = _covered(told)
    for fault in FAULTS:
        met = {moment: count for (name, moment), count in covered.items() if name == fault.name}
        lines.append(f"  {fault.name:<24}" + "  ".join(f"{m} {n}" for m, n in sorted(met.items())))
    lines += ["", *(f"BROKEN seed {one.seed}: {one.broken[0]}" for one in told if one.broken)]
    return "\n".join(lines).rstrip() + "\n"


def as_markdown(told: Sequence[Told], took_s: float) -> str:
    """Return the part of `docs/reliability.md` that a campaign writes."""
    lines = [
        described(),
        "",
        "| | |",
        "|---|---|",
        *(f"| {name} | {value} |" for name, value in totals(told)),
    ]
    lines += [f"| took | {took_s:.0f} s |", ""]
    lines += ["| Diagnosis | Incidents | Noticed, ms (median / p95 / p99) | Away, ms |", "|---|---|---|---|"]
    for diagnosis, (noticed, lasted) in sorted(_by_diagnosis(told).items()):
        count = max(len(noticed), len(lasted))
        lines.append(f"| {diagnosis} | {count} | {_shares(noticed)} | {_shares(lasted)} |")
    lines += ["", "| Fault | Met in |", "|---|---|"]
    covered = _covered(told)
    for fault in FAULTS:
        met = {moment: count for (name, moment), count in covered.items() if name == fault.name}
        lines.append(f"| {fault.name} | {', '.join(f'{m} ({n})' for m, n in sorted(met.items())) or '-'} |")
    return "\n".join(lines) + "\n"
