"""What the gateway's page is written with."""

from hardcore.crisis import recording


def test_what_is_remembered_of_paths_does_not_grow_with_what_clients_choose() -> None:
    book = recording.blank()
    for number in range(recording.NAMES_MAX * 2):
        book.name_of(b"GET", b"/%d" % number)
        book.name_of(b"GET", b"/%d/" % number + b"x" * 30_000)
    kept = sum(len(said) for said in book._names)
    assert kept <= recording.NAMES_MAX * recording.NAMED_BYTES_MAX


def test_a_path_has_the_same_name_whether_it_is_remembered_or_not() -> None:
    book, target = recording.blank(), b"/" + b"x" * 1000
    assert book.name_of(b"GET", target) == book.name_of(b"GET", target + b"?a=1")
    assert book.name_of(b"GET", target) != book.name_of(b"POST", target)
