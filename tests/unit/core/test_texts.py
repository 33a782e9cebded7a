import re
import string

import msgspec
import pytest

from core.ledger.reasons import Slug
from core.settings import Settings
from core.web.app import ROUTES
from core.web.openapi import document
from core.web.problems import PROBLEM_KINDS, Outcome, Problem, problem_json, respond, safe_mode
from frontend.catalogue_problems import PROBLEMS, READ_ONLY
from frontend.render import Language, language, problem_text, read_only_because

LANGUAGES: tuple[Language, ...] = ("ko", "en")


def names_in(text: str) -> set[str]:
    return {name for _, name, _, _ in string.Formatter().parse(text) if name is not None}


def test_every_problem_has_its_text_and_every_text_its_problem() -> None:
    assert set(PROBLEMS) == set(PROBLEM_KINDS)
    assert {slug.value for slug in Slug} <= set(PROBLEM_KINDS)


@pytest.mark.parametrize("slug", sorted(PROBLEMS))
def test_both_languages_name_the_same_values(slug: str) -> None:
    assert set(PROBLEMS[slug]) == set(LANGUAGES)
    assert names_in(PROBLEMS[slug]["ko"][1]) == names_in(PROBLEMS[slug]["en"][1])
    for title, detail in PROBLEMS[slug].values():
        assert title
        assert detail
        assert "!" not in title + detail
        assert not names_in(title)


@pytest.mark.parametrize("slug", sorted(PROBLEMS))
def test_in_korean_no_particle_stands_directly_after_a_value(slug: str) -> None:
    # A unit or counter ("바이트", "번째") belongs to the number; a particle would depend on its sound.
    attached = re.findall(r"\}([가-힣]+)", PROBLEMS[slug]["ko"][1])
    assert set(attached) <= {"바이트까지", "번째"}


@pytest.mark.parametrize(
    ("header", "expected"),
    [
        (None, "en"),
        ("", "en"),
        ("ko", "ko"),
        ("ko-KR,ko;q=0.9,en;q=0.8", "ko"),
        ("en-GB,ko;q=0.9", "en"),
        ("fr,ko;q=0.3,en;q=0.2", "ko"),
        ("de-DE", "en"),
        ("ko;q=0", "en"),
        ("ko;q=nan,en;q=0.1", "en"),
        ("KO", "ko"),
        (",;q=;,=,ko;q=1.5", "ko"),
        ("x" * 5_000 + ",ko", "en"),
    ],
)
def test_the_language_is_the_one_the_client_would_rather_read(header: str | None, expected: str) -> None:
    assert language(header) == expected


def test_a_detail_repeats_values_and_never_runs_them() -> None:
    _, detail = problem_text("unknown-account", "en", account="{0.__class__}{account}")
    assert "{0.__class__}{account}" in detail


def test_a_problem_says_what_is_known_of_its_outcome() -> None:
    body = problem_json(Problem("store-busy"), "en", Settings())
    assert (body["status"], body["outcome"], body["retry_after"]) == (
        503,
        "not_done",
        Settings().retry_after_s,
    )
    assert "outcome" not in problem_json(Problem("not-found"), "en", Settings())


@pytest.mark.parametrize("lang", LANGUAGES)
def test_reading_only_is_told_with_its_reason_in_plain_words_and_asks_for_patience(lang: Language) -> None:
    settings = Settings()
    told = {why or "OTHER": problem_json(safe_mode(why or "OTHER"), lang, settings) for why in READ_ONLY}
    assert len({body["detail"] for body in told.values()}) == len(READ_ONLY)
    for why, body in told.items():
        assert body["detail"].endswith(read_only_because(why, lang))
        assert (body["type"], body["status"], body["safe"]) == ("/problems/safe-mode", 503, why)
        assert (body["outcome"], body["retry_after"]) == ("not_done", settings.safe_retry_after_s)
        assert respond(safe_mode(why), lang, settings).headers["Retry-After"] == "30"
    assert safe_mode("DISK_FULL", Outcome.UNKNOWN).outcome is Outcome.UNKNOWN


def test_the_description_names_every_route_and_no_other() -> None:
    described = msgspec.json.decode(document())
    routes = {
        path.replace(":path", ""): {method.lower() for method in table} for path, table in ROUTES.items()
    }
    routes["/api/openapi.json"] = {"get"}
    assert {path: set(table) for path, table in described["paths"].items()} == routes


def test_every_shape_the_description_refers_to_is_described() -> None:
    text = document().decode()
    shapes = msgspec.json.decode(document())["components"]["schemas"]
    assert set(re.findall(r"#/components/schemas/(\w+)", text)) <= set(shapes)


def test_settings_tell_all_their_faults_at_once() -> None:
    found = Settings.read({"CORE_READERS": "0", "CORE_BODY_BYTES_MAX": "much", "CORE_DRAIN_MS": "100"})
    assert isinstance(found, list)
    assert [fault.split()[0] for fault in found] == ["CORE_BODY_BYTES_MAX", "CORE_READERS"]


def test_settings_have_defaults_within_their_bounds() -> None:
    assert Settings.read({}) == Settings()
    assert Settings.read({"CORE_DRAIN_MS": "100"}) == Settings(drain_ms=100)


def test_a_core_that_leaves_says_that_it_did_not_run_the_request_and_no_other_problem_does() -> None:
    told = {
        slug: "X-Core-Draining" in respond(Problem(slug), "en", Settings()).headers
        for slug in PROBLEM_KINDS
        if "{" not in PROBLEMS[slug]["en"][1]
    }
    assert [slug for slug, draining in told.items() if draining] == ["leaving"]
