"""What a real core leaves on its recorder page while it works: claims, components, censuses."""

from hashlib import sha256
from pathlib import Path

from hardcore.host.recorder import PageReader, make_page
from hardcore.model.recorder import Page
from tests.integration.lone_core import ready, started
from tests.waiting import until


def test_a_core_tells_what_it_has_claimed_what_its_parts_do_and_what_fills_its_memory(tmp_path: Path) -> None:
    make_page(tmp_path / "page", "nonce-1", "boot")
    reader = PageReader(tmp_path / "page", "nonce-1")

    def page() -> Page:
        read = reader.read()
        assert isinstance(read, Page)
        return read

    with started(
        tmp_path / "data",
        sock=tmp_path / "s",
        HARDCORE_RECORDER=str(tmp_path / "page"),
        CORE_CENSUS_MS="50",
        CORE_VERIFY_AFTER_MS="0",
    ) as core:
        answer = ready(core).open("a")
        look = reader.look()
        assert look is not None
        beats, witness = look
        assert witness is not None
        assert beats.answered_seq == witness.seq == answer.body["seq"]
        auditor = until(
            lambda: next((one for one in page().components if one.name == "auditor" and one.done), None),
            "the proof of the whole ledger to be done",
        )
        assert auditor is not None
        assert (auditor.since_ns, auditor.beat_ns > 0) == (0, True)
        assert "importer" in {one.name for one in page().components}
        until(lambda: len(page().censuses) == 2, "two censuses")
        assert all(census.types and census.examined for census in page().censuses)
    reader.close()


def test_every_command_of_a_form_is_noted_under_the_key_by_which_its_sender_knows_it(tmp_path: Path) -> None:
    make_page(tmp_path / "page", "nonce-1", "boot")
    reader = PageReader(tmp_path / "page", "nonce-1")
    with started(tmp_path / "data", sock=tmp_path / "s", HARDCORE_RECORDER=str(tmp_path / "page")) as core:
        connection = ready(core).connect()
        form = {"Content-Type": "application/x-www-form-urlencoded"}
        connection.request("POST", "/start", b"currency=KRW&_idempotency_key=f1", form)
        assert connection.getresponse().read() is not None
        connection.close()
        read = reader.read()
        assert isinstance(read, Page)
        opened = [note.key_hash for note in read.finished if note.kind == "account.open"]
        assert len(opened) > 1
        assert set(opened) == {sha256(b"f1").digest()[:16].hex()}
    reader.close()
