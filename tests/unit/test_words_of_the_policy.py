"""Each setting and each word of the policy has a sentence on the dashboard, and each mode its name."""

import dataclasses

from frontend.catalogue_admin_guard import GUARD_TEXTS
from hardcore.recovery.policy import Policy, Word
from hardcore.standing import MODES

SETTINGS = {field.name for field in dataclasses.fields(Policy) if "text" in field.metadata}


def test_every_setting_of_the_policy_is_explained_on_the_dashboard_and_nothing_else_is() -> None:
    assert {name.removeprefix("set_") for name in GUARD_TEXTS if name.startswith("set_")} == SETTINGS


def test_every_word_of_the_policy_has_its_name() -> None:
    assert {name.removeprefix("word_") for name in GUARD_TEXTS if name.startswith("word_")} == set(Word)


def test_every_mode_has_its_name() -> None:
    assert {name.removeprefix("mode_") for name in GUARD_TEXTS if name.startswith("mode_")} == set(MODES)
