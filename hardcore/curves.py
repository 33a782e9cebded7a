"""What is known of each resource over time, for whoever asks: the last two days of it, and where it leads.

The manager keeps the points anyway; here they are put into one row, the older ones coarser, and given the wall's times.
A file that is written each minute was not chosen: the guard answers from memory, and after its death the points begin
anew like its judgement does. Where a slope leads beyond the horizon costs some milliseconds to find out, so it is kept
until the next stretch ends, however often a page asks.
"""

from collections.abc import Iterator
from typing import Any

from hardcore.host import clock
from hardcore.model.forecasts import Resource
from hardcore.recovery.foresight import Foresight
from hardcore.sentinel.trends import Claim, Track

#: What is further away than this is told as nothing: nobody knows so much.
FAR_NS = 90 * 86_400 * 1_000_000_000
_NS_PER_HOUR = 3_600_000_000_000


class Curves:
    """Answers what is known; keeps what was costly to find out."""

    def __init__(self) -> None:
        self._led: dict[Resource, tuple[int | None, int, Claim | None]] = {}

    def told(self, foresight: Foresight, now_ns: int) -> list[dict[str, Any]]:
        """Return each resource that is looked at: its limit, its level, its growth, and its points."""
        tracks = sorted(foresight.tracks.items())
        return [self._one(name, track, foresight.limits[name], now_ns) for name, track in tracks]

    def _one(self, resource: Resource, track: Track, limit: int, now_ns: int) -> dict[str, Any]:
        claim = self._leads(resource, track, limit)
        told = {
            "resource": str(resource),
            "limit": limit,
            "level": track.level,
            "points": list(_points(track, now_ns)),
        }
        if claim is None:
            return {**told, "per_hour": None, "per_hour_low": None, "due": None}
        hour = _NS_PER_HOUR / (track.step_ns * claim.scale)
        due_ns = int(claim.due * track.step_ns)
        return {
            **told,
            "per_hour": claim.slope.middle * hour,
            "per_hour_low": claim.slope.low * hour,
            "due": clock.wall(now_ns + due_ns) if due_ns <= FAR_NS else None,
        }

    def _leads(self, resource: Resource, track: Track, limit: int) -> Claim | None:
        number, of_limit, claim = self._led.get(resource, (None, 0, None))
        if number is None or number != track.number or of_limit != limit:
            claim = track.outlook(limit)
            self._led[resource] = (track.number, limit, claim)
        return claim


def _points(track: Track, now_ns: int) -> Iterator[list[float]]:
    """Return (seconds before now as a number <= 0, lowest, highest), the oldest first; each moment once."""
    finer_ns = [
        scale.numbers[0] * scale.size * track.step_ns if scale.numbers else now_ns for scale in track.scales
    ]
    until_ns = {scale.size: finer for scale, finer in zip(track.scales[1:], finer_ns, strict=False)}
    for scale in reversed(track.scales):
        for number, low, high in zip(scale.numbers, scale.lows, scale.highs, strict=True):
            begun_ns = number * scale.size * track.step_ns
            ended_ns = begun_ns + scale.size * track.step_ns
            if ended_ns <= until_ns.get(scale.size, ended_ns):
                yield [round((min(ended_ns, now_ns) - now_ns) / 1e9, 1), low, high]
