"""The crisis script's tag, put into the pages of the core on their way to a browser's tab. Pure.

A page need not know that it is guarded: one line before the end of its head is all that the takeover of a
living page takes; `</head>` may be left out, and then it stands before `<body>`. The tag goes only where a
browser would read it as one (not into a comment, an attribute, a script's text or a title), and only into whole pages in plain bytes; everything else passes as it came. Asking every page to
carry the tag itself was not chosen: a guest that is not our ledger would stay dark in a crisis. The changed
page is another text than the core's, so tags and digests of that one are taken off; to keep them apart by a
suffix would save nothing here, since a ledger's pages are new each time.
"""

import re

from msgspec import structs

from hardcore.crisis.heads import AnswerHead, Header, RequestHead, browser_of

TAG = b'<script type="module" src="/__hc/client.js"></script>'
#: The head's end is looked for so far into a page.
WITHIN_BYTES = 64 << 10

#: The end of the head (or the body's beginning, where that is left out), or a stretch in which it would be text. One that never ends takes the rest with it, so
#: that a page is read once and not again from each of its beginnings.
_HEAD_END = re.compile(
    rb"<!--(?:-?>|.*?--!?>|.*)"
    rb"|=\s*(?:\"[^\"]*\"?|'[^']*'?)"
    rb"|<(script|style|title|textarea|noscript|template|iframe|xmp)(?=[\s/>])(?:.*?</\1(?=[\s/>])|.*)"
    rb"|(?P<end></head(?=[\s/>])|<body(?=[\s/>]))",
    re.IGNORECASE | re.DOTALL,
)
#: Statuses whose body is no whole page.
_NO_PAGE = frozenset({204, 205, 206, 304})
#: True of the core's own bytes only.
_OF_THE_OLD_BYTES = frozenset(
    {
        b"etag",
        b"last-modified",
        b"accept-ranges",
        b"content-md5",
        b"digest",
        b"content-digest",
        b"repr-digest",
    }
)


def is_page(request: RequestHead, answer: AnswerHead) -> bool:
    """Whether an answer is a whole page in plain bytes, for a tab that waits for one."""
    if not request.navigation or answer.status in _NO_PAGE or not 200 <= answer.status <= 599:
        return False
    told = {name.lower(): value.strip().lower() for name, value in answer.headers}
    kind = told.get(b"content-type", b"").partition(b";")[0].strip()
    return kind == b"text/html" and told.get(b"content-encoding", b"identity") == b"identity"


def with_tag(page: bytes) -> bytes:
    """A page, or its beginning, with the script's tag in its head; as it was, if its head does not end in it."""
    for found in _HEAD_END.finditer(page, 0, WITHIN_BYTES):
        if found["end"] is not None:
            return b"".join((page[: found.start()], TAG, page[found.start() :]))
    return page


def fitted(
    request: RequestHead, answer: AnswerHead, body: bytes, new_browser: bytes
) -> tuple[AnswerHead, bytes]:
    """A page as its tab gets it: the script's tag, and the gateway's cookie if the browser has none.

    `body` is all of it, or at least its first WITHIN_BYTES; `new_browser` is a name nobody has yet.
    """
    headers: list[Header] = list(answer.headers)
    if browser_of(request.cookie) is None:
        headers.append((b"Set-Cookie", b"__hc=%b; Path=/; HttpOnly; SameSite=Lax" % new_browser))
    changed = with_tag(body)
    added = len(changed) - len(body)
    if added:
        headers = [(name, value) for name, value in headers if name.lower() not in _OF_THE_OLD_BYTES]
    length = None if answer.length is None else answer.length + added
    return structs.replace(answer, headers=tuple(headers), length=length), changed
