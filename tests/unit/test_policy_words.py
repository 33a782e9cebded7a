"""What is in force goes over the control socket and comes out the same; each diagnosis has words."""

import json

from frontend.catalogue_policy import DIAGNOSES
from hardcore.model.verdicts import Diagnosis
from hardcore.recovery.policy import Policy, Word, in_full, read_policy


def test_a_policy_that_is_shown_in_full_is_a_policy() -> None:
    for policy in (
        Policy(),
        Policy(disk_floor_mb=7, actions={Diagnosis.LEAK: frozenset({Word.SEND_ALERT})}),
    ):
        again = read_policy(json.dumps(in_full(policy)))
        assert isinstance(again, Policy), again
        assert in_full(again) == in_full(policy)


def test_every_diagnosis_can_be_named_to_a_person() -> None:
    assert set(DIAGNOSES) == set(Diagnosis)
