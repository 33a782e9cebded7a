from hardcore.model.recorder import Beats, Page, Threads, Witness
from hardcore.recovery.store import StoreKnowledge


def _page(epoch: int, seq: int = 0) -> Page:
    witness = Witness(seq, epoch, "h") if seq else None
    return Page("n", "b", 1, 1, Threads(), Beats(epoch=epoch), witness, None, (), (), ())


def test_the_epoch_on_a_page_is_what_its_core_raised() -> None:
    store = StoreKnowledge()
    store.saw(_page(7))
    assert (store.epoch, store.certain) == (7, True)


def test_a_core_that_never_raised_it_proves_nothing_of_the_epoch() -> None:
    store = StoreKnowledge(6, certain=False)
    store.saw(_page(0))
    assert (store.epoch, store.certain) == (6, False)


def test_an_older_cores_page_never_takes_the_epoch_back() -> None:
    store = StoreKnowledge(6, certain=False)
    store.saw(_page(5))
    assert (store.epoch, store.certain) == (6, False)


def test_the_newest_commit_anybody_saw_is_the_witness() -> None:
    store = StoreKnowledge()
    for seq in (3, 9, 4):
        store.saw(_page(7, seq))
    assert store.witness is not None
    assert store.witness.seq == 9


def test_a_page_that_nobody_could_read_changes_nothing() -> None:
    store = StoreKnowledge(6, certain=True)
    store.saw(None)
    assert store == StoreKnowledge(6, certain=True)
