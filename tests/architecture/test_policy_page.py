"""The manual of the policy is what the declarations say."""

from hardcore.recovery.policy import Policy, read_policy, shipped_text
from tests.architecture.draw_policy import PAGE, draw


def test_the_page_about_the_policy_is_drawn_from_its_declarations() -> None:
    assert PAGE.read_text(encoding="utf-8") == draw(), "python -m tests.architecture.draw_policy"


def test_the_policy_that_is_shipped_passes_its_own_check() -> None:
    assert isinstance(read_policy(shipped_text()), Policy)
