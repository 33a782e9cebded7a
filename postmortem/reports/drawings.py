"""Drawings of an incident: numbers in, inline SVG out, each with the table that says the same in words.

A drawing is geometry and nothing else: it asks nobody, takes its colours by class from `frontend/static/drawings.css`
(so a page's policy needs no exception for it), and every text in it is escaped, because threads and locks have names
that other people gave. What has no sensible picture (one moment, no sample) has none: None is returned, and the page
says so. A charting library was not chosen: four shapes need none, and a saved report has to work without a network.
"""

import math
from collections.abc import Callable, Sequence
from itertools import pairwise

import msgspec
from markupsafe import Markup

from frontend import catalogue_drawings as texts
from postmortem.reports.visible import visible

#: Of each drawing, in its own units; it is scaled to the width of what it stands in.
WIDTH = 720
STEPS_MAX, POINTS_MAX, WAITS_MAX, SPANS_MAX = 32, 600, 12, 400
DAY_S = 86_400

_BAR_HEIGHT, _BAR_TOP = 28, 8
#: A piece of the bar is at least so wide that it can be seen, and numbered from the second width on.
_PIECE_MIN, _NUMBERED_MIN = 3, 22
_CURVE_HEIGHT, _CURVE_LEFT, _CURVE_FOOT = 200, 64, 24
_RING_HEIGHT, _RING_RADIUS = 352, 110
#: Two lie beside each other: no height is needed for those above and below.
_PAIR_HEIGHT = 144
_NAME_CHARS_MAX = 28
_MIB = 1 << 20


class Drawing(msgspec.Struct, frozen=True):
    """A picture, and the same as a table: `head` names the columns of `rows`. `title` says what is to be seen.

    `legend`: what the numbers in the picture stand for, where it has numbers.
    """

    title: str
    svg: Markup
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    legend: tuple[str, ...] = ()


class Moment(msgspec.Struct, frozen=True):
    """One moment of a timeline: its name as people read it, and when it was, in ms after the fault.

    `outage`: nobody was served in the stretch that ends with it.
    """

    name: str
    offset_ms: float
    outage: bool = True


class Wait(msgspec.Struct, frozen=True):
    """Thread `who` waits for `lock`, which thread `holder` has."""

    who: str
    lock: str
    holder: str


class Span(msgspec.Struct, frozen=True):
    """A stretch of a day, in seconds from its beginning. `kind`: `up`, `down`, `reads`, `off` or `unknown`."""

    from_s: float
    to_s: float
    kind: str
    label: str = ""


def draw_timeline(moments: Sequence[Moment], lang: str) -> Drawing | None:
    """Return the bar of a timeline, one piece for each stretch between two moments, with durations and shares.

    Bar and shares are of the outage; what came after it stands in the table alone. Without an outage that has a length
    they are of the whole time. None: there is no stretch with a length.
    """
    kept = sorted(moments[:STEPS_MAX], key=lambda one: one.offset_ms)
    if len(kept) < 2 or kept[-1].offset_ms <= kept[0].offset_ms:
        return None
    drawn = [one for one in kept if one.outage]
    if len(drawn) < 2 or drawn[-1].offset_ms <= drawn[0].offset_ms:
        drawn = kept
    whole_ms = drawn[-1].offset_ms - drawn[0].offset_ms
    lengths = [after.offset_ms - before.offset_ms for before, after in pairwise(kept)]
    shown = lengths[: len(drawn) - 1]
    pieces, legend, left = [], [], 0.0
    for number, (width, length_ms, after) in enumerate(zip(_widths(shown), shown, drawn[1:], strict=True), 1):
        pieces.append(_piece(number, left, width, outage=after.outage))
        if width >= _NUMBERED_MIN:
            legend.append(f"{number} {visible(after.name)} {duration_text(length_ms, lang)}")
        left += width
    rows = [
        (
            "" if number == 0 else str(number),
            visible(moment.name),
            duration_text(moment.offset_ms, lang),
            duration_text(lengths[number - 1], lang) if number else "",
            f"{100 * lengths[number - 1] / whole_ms:.0f} %" if 0 < number < len(drawn) else "",
        )
        for number, moment in enumerate(kept)
    ]
    title = _word("timeline", lang).format(whole=duration_text(whole_ms, lang))
    picture = _svg(title, _BAR_HEIGHT + 2 * _BAR_TOP, pieces)
    return Drawing(title, picture, _words("timeline_head", lang), tuple(rows), tuple(legend))


def draw_memory(points: Sequence[tuple[float, int]], limit_bytes: int | None, lang: str) -> Drawing | None:
    """Return the curve of memory over time: `points` are (seconds before the end as a number <= 0, bytes).

    `limit_bytes`: drawn as a line. None: fewer than two points.
    """
    return _draw_curve(points, limit_bytes, lang, "memory_head", lambda at_s: f"{at_s:.1f} s")


def draw_course(points: Sequence[tuple[float, int]], limit_bytes: int | None, lang: str) -> Drawing | None:
    """Return the curve of memory that a living process has: the same, of hours instead of seconds."""

    def ago(at_s: float) -> str:
        return _word("ago", lang).format(length=duration_text(-1000 * at_s, lang))

    return _draw_curve(points, limit_bytes, lang, "course_head", ago)


def _draw_curve(
    points: Sequence[tuple[float, int]],
    limit_bytes: int | None,
    lang: str,
    head: str,
    when: Callable[[float], str],
) -> Drawing | None:
    kept = _thinned(sorted(points))
    if len(kept) < 2 or kept[-1][0] <= kept[0][0]:
        return None
    most = max(1, *(held for _, held in kept), limit_bytes or 0)
    first_s, last_s = kept[0][0], kept[-1][0]

    def across(at_s: float) -> float:
        return _CURVE_LEFT + (WIDTH - _CURVE_LEFT - 8) * (at_s - first_s) / (last_s - first_s)

    def down(held: float) -> float:
        return 8 + (_CURVE_HEIGHT - _CURVE_FOOT - 8) * (1 - held / (most * 1.05))

    line = " ".join(f"{across(at_s):.1f},{down(held):.1f}" for at_s, held in kept)
    foot = _CURVE_HEIGHT - _CURVE_FOOT
    parts = [
        Markup('<line class="d-axis" x1="{}" y1="{}" x2="{}" y2="{}"/>').format(
            _CURVE_LEFT, foot, WIDTH - 8, foot
        ),
        Markup('<polyline class="d-curve" points="{}"/>').format(line),
        _text("d-label", 4, down(kept[-1][1]) + 4, _mib(kept[-1][1])),
        _text("d-label", _CURVE_LEFT, _CURVE_HEIGHT - 6, when(first_s)),
        _text("d-label d-end", WIDTH - 8, _CURVE_HEIGHT - 6, when(last_s)),
    ]
    if limit_bytes:
        height = down(limit_bytes)
        parts.append(
            Markup('<line class="d-limit" x1="{}" y1="{:.1f}" x2="{}" y2="{:.1f}"/>').format(
                _CURVE_LEFT, height, WIDTH - 8, height
            )
        )
        parts.append(_text("d-label d-bad", 4, height + 4, _mib(limit_bytes)))
    title = _word("memory", lang).format(first=_mib(kept[0][1]), last=_mib(kept[-1][1]))
    if limit_bytes:
        title += " " + _word("memory_limit", lang).format(limit=_mib(limit_bytes))
    rows = tuple((when(at_s), _mib(held)) for at_s, held in _thinned(kept, 24))
    return Drawing(title, _svg(title, _CURVE_HEIGHT, parts), _words(head, lang), rows)


def draw_ring(waits: Sequence[Wait], lang: str) -> Drawing | None:
    """Return threads that wait for each other as a ring of arrows, each with the lock it is about. None: no wait."""
    kept = list(waits[:WAITS_MAX])
    names = list(dict.fromkeys(name for one in kept for name in (one.who, one.holder)))
    if len(names) < 2:
        return None
    height = _PAIR_HEIGHT if len(names) == 2 else _RING_HEIGHT
    places = {name: _on_circle(number / len(names), height) for number, name in enumerate(names)}
    parts: list[Markup] = [
        Markup(
            '<defs><marker id="d-tip" viewBox="0 0 8 8" refX="8" refY="4" markerWidth="8" markerHeight="8" '
            'orient="auto"><path class="d-tip" d="M0,0 L8,4 L0,8 z"/></marker></defs>'
        )
    ]
    for one in kept:
        parts += _arrow(places[one.who], places[one.holder], one.lock)
    for name, (across, down) in places.items():
        parts.append(
            Markup('<rect class="d-thread" x="{:.1f}" y="{:.1f}" width="170" height="32" rx="6"/>').format(
                across - 85, down - 16
            )
        )
        parts.append(_text("d-name", across, down + 5, _cut(name)))
    rows = tuple((visible(one.who), visible(one.lock), visible(one.holder)) for one in kept)
    title = " · ".join(
        _word("waits", lang).format(who=visible(one.who), holder=visible(one.holder)) for one in kept
    )
    return Drawing(title, _svg(title, height, parts), _words("ring_head", lang), rows)


def draw_day(spans: Sequence[Span], lang: str, day_s: float = DAY_S) -> Drawing | None:
    """Return the strip of the last `day_s` seconds; what no span covers is drawn as unknown. None: no span in it."""
    kept = [
        Span(max(0.0, one.from_s), min(day_s, one.to_s), one.kind, one.label)
        for one in spans[:SPANS_MAX]
        if one.from_s < day_s and one.to_s > 0 and one.to_s > one.from_s
    ]
    if not kept:
        return None
    parts = [
        Markup('<rect class="d-span d-unknown" x="0" y="{}" width="{}" height="{}"/>').format(
            _BAR_TOP, WIDTH, _BAR_HEIGHT
        )
    ]
    # The long ones first: an outage of a second must not vanish under the hours around it.
    for one in sorted(kept, key=lambda span: span.to_s - span.from_s, reverse=True):
        left, width = WIDTH * one.from_s / day_s, WIDTH * (one.to_s - one.from_s) / day_s
        parts.append(
            Markup('<rect class="d-span d-{}" x="{:.2f}" y="{}" width="{:.2f}" height="{}">{}</rect>').format(
                one.kind if one.kind in texts.SPANS else "unknown",
                left,
                _BAR_TOP,
                max(1.5, width),
                _BAR_HEIGHT,
                Markup("<title>{}</title>").format(visible(one.label)) if one.label else "",
            )
        )
    down_s = sum(one.to_s - one.from_s for one in kept if one.kind == "down")
    title = _word("day", lang).format(down=duration_text(down_s * 1000, lang))
    rows = tuple(
        (
            _hours_ago(day_s - one.from_s, lang),
            duration_text((one.to_s - one.from_s) * 1000, lang),
            texts.SPANS.get(one.kind, texts.SPANS["unknown"])[lang],
            visible(one.label),
        )
        for one in sorted(kept, key=lambda span: span.from_s)
    )
    return Drawing(title, _svg(title, _BAR_HEIGHT + 2 * _BAR_TOP, parts), _words("day_head", lang), rows)


def duration_text(length_ms: float, lang: str) -> str:
    """Return a length of time for people: the larger, the coarser."""
    if length_ms < 1000:
        return f"{length_ms:.1f} ms" if abs(length_ms) < 10 and length_ms % 1 else f"{length_ms:.0f} ms"
    seconds = length_ms / 1000
    for unit, size in (("h", 3600), ("min", 60)):
        if seconds >= 2 * size:
            return f"{seconds / size:.0f}{texts.UNITS[unit][lang]}"
    return f"{seconds:.1f}{texts.UNITS['s'][lang]}"


def _widths(lengths: Sequence[float]) -> list[float]:
    """Return how wide each stretch is drawn: by its length, but none so narrow that it can't be seen."""
    whole = sum(lengths)
    free = WIDTH - _PIECE_MIN * len(lengths)
    return [_PIECE_MIN + free * length / whole for length in lengths]


def _piece(number: int, left: float, width: float, *, outage: bool) -> Markup:
    kind = f"d-piece d-{'odd' if number % 2 else 'even'}" + ("" if outage else " d-after")
    piece = Markup('<rect class="{}" x="{:.2f}" y="{}" width="{:.2f}" height="{}"/>').format(
        kind, left, _BAR_TOP, width, _BAR_HEIGHT
    )
    if width < _NUMBERED_MIN:
        return piece
    return piece + _text("d-number", left + width / 2, _BAR_TOP + _BAR_HEIGHT / 2 + 5, str(number))


def _arrow(start: tuple[float, float], end: tuple[float, float], lock: str) -> list[Markup]:
    """Return an arrow that bends away from the middle's straight line, so that there and back don't meet."""
    length = math.dist(start, end) or 1.0
    aside = ((end[1] - start[1]) / length, -(end[0] - start[0]) / length)
    bend = ((start[0] + end[0]) / 2 + 70 * aside[0], (start[1] + end[1]) / 2 + 70 * aside[1])
    from_edge, to_edge = _edge(start, bend), _edge(end, bend)
    middle = tuple((from_edge[i] + 2 * bend[i] + to_edge[i]) / 4 for i in (0, 1))
    return [
        Markup(
            '<path class="d-wait" d="M{:.1f},{:.1f} Q{:.1f},{:.1f} {:.1f},{:.1f}" marker-end="url(#d-tip)"/>'
        ).format(*from_edge, *bend, *to_edge),
        # Outside of the ring, on the side that the arrow bends to.
        _text("d-lock", middle[0], middle[1] + (18 if aside[1] > 0 else -6), _cut(lock)),
    ]


def _edge(place: tuple[float, float], towards: tuple[float, float]) -> tuple[float, float]:
    """Return where a line from the middle of a thread's box to `towards` leaves the box."""
    across, down = towards[0] - place[0], towards[1] - place[1]
    scale = min(85 / abs(across) if across else math.inf, 16 / abs(down) if down else math.inf, 1.0)
    return place[0] + across * scale, place[1] + down * scale


def _on_circle(share: float, height: float) -> tuple[float, float]:
    """Return a place on the ring, which is wider than high as its boxes are."""
    turn = 2 * math.pi * share - math.pi
    return WIDTH / 2 + 2.2 * _RING_RADIUS * math.cos(turn), height / 2 + _RING_RADIUS * math.sin(turn)


def _thinned(points: Sequence[tuple[float, int]], most: int = POINTS_MAX) -> list[tuple[float, int]]:
    """Return at most `most` points, the last one among them: of each stretch the one with the most memory."""
    if len(points) <= most:
        return list(points)
    size = math.ceil(len(points) / (most - 1))
    groups = [points[at : at + size] for at in range(0, len(points), size)]
    chosen = [max(group, key=lambda point: point[1]) for group in groups]
    return chosen if chosen[-1] == points[-1] else [*chosen[: most - 1], points[-1]]


def _svg(title: str, height: int, parts: Sequence[Markup]) -> Markup:
    return Markup(
        '<svg class="drawing" viewBox="0 0 {} {}" role="img" aria-label="{}" focusable="false">{}</svg>'
    ).format(WIDTH, height, title, Markup("").join(parts))


def _text(kind: str, across: float, down: float, said: str) -> Markup:
    return Markup('<text class="{}" x="{:.1f}" y="{:.1f}">{}</text>').format(kind, across, down, said)


def _cut(name: str) -> str:
    told = visible(name)
    return told if len(told) <= _NAME_CHARS_MAX else told[: _NAME_CHARS_MAX - 1] + "…"


def _mib(held: float) -> str:
    return f"{held / _MIB:.0f} MiB"


def _hours_ago(seconds: float, lang: str) -> str:
    return _word("ago", lang).format(length=duration_text(seconds * 1000, lang))


def _word(key: str, lang: str) -> str:
    return texts.WORDS[key][lang]


def _words(key: str, lang: str) -> tuple[str, ...]:
    return tuple(texts.HEADS[key][lang])
