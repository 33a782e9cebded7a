"""A promise on a real house: given in an outage, kept over the gateway's death too, booked once."""

import base64
import http.client
import json
from urllib.parse import urlencode

from tests.integration.house import House, transaction
from tests.integration.houses import MakeHouse
from tests.waiting import until

PATH = "/api/ledger/transactions"
FORM = "application/x-www-form-urlencoded"
#: Whoever has to wait at all is promised at once.
QUICK = {"hold_ms": 1}


def post(house: House, path: str, body: str, **headers: str) -> int:
    """Send something unsafe once; the status of the answer."""
    connection = http.client.HTTPConnection(house.url.removeprefix("http://"), timeout=20)
    try:
        connection.request(
            "POST", path, body, {name.replace("_", "-"): told for name, told in headers.items()}
        )
        answer = connection.getresponse()
        answer.read()
        return answer.status
    finally:
        connection.close()


def outcome(house: House, key: str) -> str:
    """What became of a promise."""
    told = house.ask("GET", f"/__hc/receipts/{key}")
    return str(told.body.get("outcome", told.status))


def test_a_promise_outlives_the_core_and_the_gateway_and_is_booked_once(new_house: MakeHouse) -> None:
    house = new_house(gateway=QUICK).up()
    house.open_accounts()
    house.hit("core")
    body = json.dumps(transaction("k1"))
    json_kind = {"Content_Type": "application/json", "Prefer": "respond-async", "Idempotency_Key": "k1"}
    assert post(house, PATH, body, **json_kind) == 202
    house.hit("gateway")
    house.running()
    until(lambda: outcome(house, "k1") in {"done", "already_done"}, "the promise to be kept")
    assert post(house, PATH, body, **json_kind) == 201  # the ledger knows the key, and answers as before
    assert house.booked() == ["k1"]


def test_a_kept_form_is_booked_as_the_page_would_have(new_house: MakeHouse) -> None:
    house = new_house(gateway=QUICK).up()
    house.open_accounts()
    fields = {"name": "여행", "type": "asset", "currency": "KRW", "_idempotency_key": "f1"}
    wish = base64.urlsafe_b64encode(urlencode(fields).encode()).decode()
    kept = urlencode({"key": "f1", "path": "/accounts", "type": FORM, "body": wish, "from": "/accounts"})
    house.hit("core")
    assert post(house, "/__hc/keep", kept, Content_Type=FORM, Accept="text/html") == 303
    house.running()
    until(lambda: outcome(house, "f1") == "done", "the form to be done")
    accounts = house.ask("GET", "/api/ledger/accounts").body["items"]
    assert [one["name"] for one in accounts].count("여행") == 1
