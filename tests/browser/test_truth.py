"""A claim is made exactly where its fact is: the one room that chooses the words, asked of thousands of situations.

Each word is its own code here, so that what is said is known without reading. What has to be known before it is said
stands twice: as a sentence in the catalogue (`FACTS`), and as a condition below; a sentence that has neither, and is not
among those that claim nothing, fails the test. That the frames themselves come from facts is shown beside the gateway.
"""

import random
import re
from collections.abc import Callable
from typing import Any, Final

import msgspec

from frontend.catalogue_crisis import CRISIS, FACTS
from tests.browser.scripted_gateway import SERVING
from tests.browser.scripted_pages import OpenLedger

SITUATIONS: Final = 2_500
SEED: Final = 8
FINAL: Final = frozenset({"R8", "OFF"})
LATE: Final = frozenset({"R7", "R7b"})
SHORT: Final = {"low_s": 0, "high_s": 1, "samples": 9}
LONG: Final = {"low_s": 2, "high_s": 4, "samples": 9}
TIME: Final = "2026-01-01T00:00:00.000Z"

#: Sentences and small words that claim nothing of the ledger, of the text or of anybody, or what the code itself does.
PLAIN: Final = frozenset(
    [
        "R1",
        "R3",
        "R7",
        "R7.stage",
        "R15.line",
        "back.line",
        "close",
        "details",
        "elapsed",
        "incident",
        "keep",
        "keep.byhand",
        "other",
        "reopen",
        "reopens",
        "state",
        "took",
        "undo",
        "doubtful.now",
        "doubtful.wait",
        "keepable.do",
        "keepable.now",
        "keepable.wait",
        "not_done.now",
        "not_done.wait",
        "unknown.now",
        "unknown.wait",
    ]
)
#: What every core that ever answered has kept: it answers after the flush to the disk, and is proven before it serves.
LAWS: Final = frozenset({"R1.line"})
#: Said elsewhere than by this room, and shown there: drafts, and the button that copies.
ELSEWHERE: Final = frozenset({"R13", "R13.unsent", "R13.tried", "keep.done"})
_PARTS: Final = ("mark", "phase", "plan", "stage", "title")


class Situation(msgspec.Struct, frozen=True):
    """One view of an outage and what is known beside it, as the script has them."""

    mode: str
    frame: dict[str, Any]
    back: dict[str, Any]
    silent: bool
    facts: dict[str, Any]

    @property
    def text(self) -> Any:
        """The state that the last frame told."""
        return self.frame["text"]

    @property
    def card(self) -> bool:
        """Whether the overlay of an outage stands there."""
        return self.mode == "card"

    @property
    def speaks_of_text(self) -> bool:
        """Whether it says where what was typed is: in an outage, and to whoever is signed out."""
        return self.mode == "out" or (self.card and not self.facts["request"])

    @property
    def waits(self) -> bool:
        """Whether it speaks of requests that wait: somebody tries, and no form's own answer stands beside them."""
        return self.card and self.text not in FINAL and not self.facts["request"]

    @property
    def timed(self) -> bool:
        """Whether it may speak of time."""
        return self.card and self.text not in FINAL and not self.facts["unheard"]

    @property
    def reads_only(self) -> bool:
        """Whether the ledger is served and takes no changes."""
        return self.mode not in {"lost", "out"} and self.text is None and bool(self.frame["safe"])

    @property
    def unsound_bar(self) -> bool:
        """The same because the ledger itself is not whole."""
        broken = (
            self.mode == "unsound" or self.frame["safe"] == "STORE_CORRUPT" or self.frame["sound"] is False
        )
        return self.reads_only and broken

    @property
    def answered(self) -> bool:
        """Whether what became of a form has a place: the page that answers it."""
        strip = self.mode in {"short", "lost", "again"} or (
            self.mode == "sign" and self.text in {*FINAL, "R1"}
        )
        strip = (
            strip
            or (self.mode == "sign" and self.text in LATE)
            or (self.mode == "calm" and self.facts["slow"])
        )
        unsound = self.mode == "unsound" and not (self.facts["alive"] and self.frame["safe"])
        return self.card or self.mode == "result" or unsound or (strip and not self.facts["alive"])


Holds = Callable[[Situation], bool]


def _request(*kinds: str) -> Holds:
    return lambda one: one.answered and one.facts["request"] in kinds


#: What has to be known before each claim, as a condition: the other half of the catalogue's FACTS.
TRUE: Final[dict[str, Holds]] = {
    "R0": lambda one: one.mode == "calm" and one.facts["slow"] and not one.frame["trial"],
    "R0.trial": lambda one: one.mode == "calm" and one.facts["slow"] and one.frame["trial"] > 0,
    "R1b": lambda one: one.waits and one.frame["held"] > 0,
    "R1b.open": lambda one: one.waits and one.frame["promised"] < one.frame["held"],
    "R1c": lambda one: one.waits and 0 < one.frame["promised"] == one.frame["held"] and bool(one.facts["receipt"]),
    "R1p": lambda one: one.waits and one.facts["pending"] > 0,
    "R2": lambda one: one.card and one.text == "R2",
    "draft.stored": lambda one: one.facts["draft"] == "stored" and one.speaks_of_text,
    "draft.page": lambda one: one.facts["draft"] == "page" and one.speaks_of_text,
    "eta.none": lambda one: one.timed and not one.frame["eta"] and one.text not in LATE and one.frame["samples"] < 5,
    "eta.range": lambda one: one.timed and one.frame["eta"] == LONG,
    "eta.within": lambda one: one.timed and one.frame["eta"] == SHORT,
    "R3.took": lambda one: one.mode == "result" and one.back["outage_ms"] is not None,
    "R3.verified": lambda one: one.mode == "result" and one.back["verified"] is True,
    "R3b.line": lambda one: one.mode == "result" and one.back["verified"] is None,
    "R3c": lambda one: one.mode == "short" and one.back["outage_ms"] == 212,
    "R3c.seconds": lambda one: one.mode == "short" and one.back["outage_ms"] == 3_000,
    "R3c.verified": lambda one: one.mode == "short" and one.back["verified"] is True,
    "R9": lambda one: one.reads_only and not one.unsound_bar,
    "R9.DISK_FULL": lambda one: one.reads_only and not one.unsound_bar,
    "R10": lambda one: one.mode == "unsound" or one.unsound_bar,
    "R10.safe": lambda one: one.unsound_bar,
    "R7.alerted": lambda one: one.card and one.text == "R7" and one.frame["alerted_at"] == TIME,
    "R7b.line": lambda one: one.card and one.text == "R7b",
    "R8": lambda one: one.mode in {"card", "sign"} and one.text == "R8",
    "OFF": lambda one: one.mode in {"card", "sign"} and one.text == "OFF",
    "R11": lambda one: one.mode == "lost" and not one.silent,
    "R11.silent": lambda one: one.mode == "lost" and one.silent,
    "R12": lambda one: one.mode == "out",
    "R11.kept": lambda one: one.mode == "lost" and one.facts["alive"],
    "not_done.line": _request("not_done"),
    "unknown.line": _request("unknown"),
    "keepable.line": _request("keepable"),
    "doubtful.line": _request("doubtful"),
}  # fmt: skip


def _situation(draw: random.Random) -> Situation:
    mode = draw.choice(["calm", "sign", "card", "result", "short", "lost", "again", "unsound", "out"])
    out = mode in {"sign", "card"} or (mode == "lost" and draw.random() < 0.5)
    text = draw.choice(["R1", "R2", "R7", "R7b", "R8", "OFF"]) if out else None
    held = draw.choice([0, 0, 2])
    frame = {
        **SERVING, "text": text, "planned": text == "R2", "stage": draw.choice([None, 1, 3]) if out else None,
        "held": held, "promised": draw.randint(0, held), "trial": draw.choice([0, 1]),
        "eta": draw.choice([None, SHORT, LONG]) if text in {"R1", "R2"} else None, "samples": draw.choice([3, 9]),
        "alerted_at": draw.choice([None, TIME, "never"]), "safe": draw.choice([None, "DISK_FULL", "STORE_CORRUPT"]),
        "sound": draw.choice([None, True, False]), "incident": draw.choice([None, "2026-1"]),
    }  # fmt: skip
    back = {"outage_ms": draw.choice([None, 212, 3_000]), "verified": draw.choice([None, True])}
    facts = {
        "pending": draw.choice([0, 2]), "receipt": draw.choice([None, "a-key-f0f1f2f3"]),
        "draft": draw.choice([None, "page", "stored"]), "slow": draw.random() < 0.5, "alive": draw.random() < 0.6,
        "unheard": draw.random() < 0.2, "request": draw.choice([None, None, "not_done", "unknown", "keepable", "doubtful"]),
    }  # fmt: skip
    return Situation(mode, frame, back, draw.random() < 0.5, facts)


def test_every_claim_of_the_catalogue_names_its_fact_and_has_its_condition() -> None:
    claims = {code for code in FACTS if code not in ELSEWHERE}
    assert claims <= {*TRUE}
    assert {*TRUE} - claims <= {code for code in TRUE if code.rpartition(".")[0] in FACTS}  # parts of one
    rest = {code for code in CRISIS if code not in FACTS and code.rpartition(".")[0] not in FACTS}
    assert rest == {*PLAIN, *LAWS} | {code for code in rest if code.partition(".")[0] in _PARTS}


def test_a_claim_is_made_exactly_where_its_fact_is(open_ledger: OpenLedger) -> None:
    draw = random.Random(SEED)
    asked = [_situation(draw) for _ in range(SITUATIONS)]
    told = open_ledger().evaluate(
        """async ([asked, codes]) => {
          const { face } = await import("/source/wording.js");
          const words = Object.fromEntries(codes.map((code) => [code, `[${code}]`]));
          return asked.map(({ mode, frame, back, silent, facts }) => JSON.stringify(
            face({ mode, frame, back, silent, begun_ms: 0, reached: { 1: 0 } }, facts, 9000, words)));
        }""",
        [msgspec.to_builtins(asked), [*CRISIS]],
    )
    seen: set[str] = set()
    for one, text in zip(asked, told, strict=True):
        said = set(re.findall(r"\[([\w.]+)\]", text))
        seen |= said
        for code, holds in TRUE.items():
            assert (code in said) == holds(one), (code, one, text)
    assert {*TRUE} <= seen  # each of them was said at least once
