"""The description of the API held against a real core: whatever its shapes allow or forbid, the answer is one it promises."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import schemathesis
from hypothesis import HealthCheck, Phase, given, settings
from schemathesis import GenerationMode
from schemathesis.checks import not_a_server_error
from schemathesis.core.result import Ok
from schemathesis.specs.openapi.checks import (
    content_type_conformance,
    response_schema_conformance,
    status_code_conformance,
)

from core.web.openapi import document
from tests.integration.lone_core import Core, ready, started

CHECKS = [
    not_a_server_error,
    status_code_conformance,
    content_type_conformance,
    response_schema_conformance,
]

BOUNDED = settings(
    max_examples=8,
    derandomize=True,
    database=None,
    deadline=None,
    phases=[Phase.generate],
    suppress_health_check=list(HealthCheck),
)


@pytest.fixture(scope="module")
def core(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Core]:
    data: Path = tmp_path_factory.mktemp("described") / "data"
    data.mkdir()
    with started(data, CORE_BACKUP_EVERY_H="0") as made:
        ready(made)
        made.open("assets:cash")
        made.open("expense:food", "expense")
        yield made
        verdict = made.ask("GET", "/api/ledger/verify")
        assert verdict.body["ok"], verdict.body


API = schemathesis.openapi.from_dict(json.loads(document()))
OPERATIONS = [found.ok() for found in API.get_all_operations() if isinstance(found, Ok)]


@pytest.mark.parametrize("operation", OPERATIONS, ids=lambda one: one.label)
def test_every_answer_is_one_that_the_description_promises(core: Core, operation: Any) -> None:
    strategies = [operation.as_strategy(generation_mode=mode) for mode in GenerationMode]

    @BOUNDED
    @given(case=strategies[0] | strategies[1])
    def ask(case: Any) -> None:
        case.call_and_validate(base_url=f"http://127.0.0.1:{core.port}", checks=CHECKS)

    ask()


def test_every_operation_can_be_read_by_a_stranger() -> None:
    described = json.loads(document())["paths"].values()
    assert len(OPERATIONS) == sum(len(methods) for methods in described)
