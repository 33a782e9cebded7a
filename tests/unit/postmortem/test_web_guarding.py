"""The dashboard's words about guarding: the safe mode is asked about, the policy is shown and read again."""

from pathlib import Path

import pytest

from tests.unit.postmortem.web_archive import Archive, Visitor

STATUS = {
    "state": "SAFE_MODE",
    "phase": "RUNNING",
    "wanted": "SAFE",
    "safe_by": "operator",
    "safe_reason": "<b>audit</b>",
    "mode": "assist",
    "policy_fault": "failover_policy.json: line 2: mode: no",
    "components": [
        {"name": "importer", "works_ms": 900, "beat_age_ms": 900, "limit_ms": 500, "done": 3},
        {"name": "exporter", "works_ms": None, "beat_age_ms": None, "limit_ms": 500, "done": 0},
    ],
    "history": [
        {"at": "2026-11-22T10:00:00Z", "after": "SAFE_MODE", "reason": "the operator asked for it"},
        {"at": 3, "after": "NONSENSE", "reason": None},
    ],
}


@pytest.fixture
def visitor(tmp_path: Path) -> Visitor:
    (tmp_path / "incidents").mkdir()
    return Visitor(tmp_path, Archive(), status=STATUS)


@pytest.mark.parametrize("lang", ["ko", "en"])
def test_what_is_guarded_how_is_shown_and_made_harmless(visitor: Visitor, lang: str) -> None:
    visitor.lang = lang
    page = visitor.get("/admin/").text
    assert "&lt;b&gt;audit" in page
    assert "line 2: mode: no" in page
    assert 'value="off"' in page, "it is on, so it can be ended"
    assert "the operator asked for it" in page
    assert "900 ms" in page


def test_the_safe_mode_is_asked_about_before_it_is_ordered(visitor: Visitor) -> None:
    assert visitor.post("/admin/safe-mode", wish="on").status == 200
    assert [one["verb"] for one in visitor.asked] == []
    answer = visitor.post("/admin/safe-mode", wish="on", sure="1")
    assert answer.headers["location"] == "/admin/?said=safe_on"
    assert visitor.asked[-1] == {"verb": "safe-mode", "on": True, "reason": "dashboard"}
    assert visitor.written == [("safe-mode", "on", "", "asked for")]
    assert visitor.post("/admin/safe-mode", wish="perhaps", sure="1").status == 404


def test_the_policy_is_shown_in_words_with_what_is_wrong_with_its_file(visitor: Visitor) -> None:
    visitor.answers["policy"] = {
        "ok": True,
        "policy": {
            "mode": "assist",
            "await_operator_sec": 300,
            "on_await_timeout": ["SEND_ALERT"],
            "actions": {"FROZEN": ["SEND_ALERT", "REBOOT_PROCESS"]},
            "gateway": {"hold_ms": 5},
        },
        "fault": "line 1: <script>",
    }
    page = visitor.get("/admin/policy").text
    assert "line 1: &lt;script&gt;" in page
    assert "A person is waited for this long (s)." in page
    assert "tell · restart" in page
    assert "gateway.hold_ms" in page


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        ({"ok": True, "changed": [], "later": []}, "policy_read"),
        ({"ok": False, "code": "policy-faults", "values": {"faults": []}}, "policy_faulty"),
        ({"ok": False, "code": "not-read"}, "guard_refused"),
        (None, "guard_away"),
    ],
)
def test_what_came_of_reading_the_policy_again_is_said(
    visitor: Visitor, answer: dict[str, object] | None, said: str
) -> None:
    visitor.answers["policy-reload"] = answer
    assert visitor.post("/admin/policy/reload").headers["location"] == f"/admin/policy?said={said}"
    assert visitor.get(f"/admin/policy?said={said}").status == 200


def test_without_a_token_nothing_is_ordered(visitor: Visitor) -> None:
    assert visitor.post("/admin/safe-mode", wish="on", sure="1", token="").status == 403
    assert visitor.post("/admin/policy/reload", token="").status == 403
    assert visitor.asked == []
