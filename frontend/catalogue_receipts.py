"""What is said of a wish that was promised to be carried out later: its receipt, and what became of it.

One catalogue for the gateway's own pages and for the scripts of the ledger's pages, because both say the same of the
same receipt. A key is the code of a state (R1c, R5, ...) or of a part of it. Each outcome that the gateway can tell
has its heading and its line; what claims something names its fact in `FACTS`. In Korean no particle stands right
after a value. What the ledger itself says of a refusal is the ledger's sentence and not in here.
"""

from typing import Final

#: code -> (ko, en)
RECEIPTS: Final[dict[str, tuple[str, str]]] = {
    "R1b": ("기다리는 요청 {n}건", "{n} waiting"),
    "R1b.line": (
        "서버가 돌아오면 한 번만 처리해요. 다시 누르지 않아도 돼요.",
        "Each one will be handled once when the server is back. No need to press again.",
    ),
    "R1c": (
        "이 창을 닫아도 요청은 남아 있어요. 접수 번호: {id}",
        "You can close this window; the request stays. Receipt: {id}",
    ),
    # Settled ones that no page has told yet.
    "R4": ("요청 결과", "What happened to your requests"),
    "R4.line": (
        "처리됨 {done}건 / 이미 처리돼 있었음 {already}건 / 처리하지 않음 {not_done}건",
        "Done {done} / Was already done {already} / Not done {not_done}",
    ),
    "R4.open": ("확인이 필요한 요청 {n}건", "{n} to be checked"),
    "R4.view": ("내역 보기", "View"),
    "R4.close": ("닫기", "Close"),
    # A single one, on its own page and below its form.
    "done": ("요청을 처리했어요", "Your request was done"),
    "already_done": ("이 요청은 이미 처리됐어요", "This request was already done"),
    "already_done.line": ("응답만 전달하지 못했어요.", "Only the reply was lost."),
    "not_done": ("요청을 처리하지 않았어요", "Your request was not done"),
    "not_done.line": ("아직 필요하면 다시 보내 주세요.", "Please send it again if you still want it."),
    "refused": ("요청을 처리하지 않았어요", "Your request was not done"),
    "refused.line": ("장부가 받지 않았어요.", "The ledger did not take it."),
    "set_aside": ("이 요청은 따로 보관했어요", "This request was set aside"),
    "set_aside.line": (
        "처리 중에 서버가 멈춰서 더는 자동으로 시도하지 않아요.",
        "The server stopped while handling it, so it will not be tried again by itself.",
    ),
    "set_aside.number": ("번호: {id}", "Number: {id}"),
    "unknown": ("처리됐는지 아직 알 수 없어요", "It is not known whether this was done"),
    "unknown.line": ("먼저 내역을 확인해 주세요.", "Please check the records first."),
    "number": ("접수 번호: {id}", "Receipt: {id}"),
    "sent": ("보낸 때: {when}", "Sent: {when}"),
    # Too much time has gone to carry it out without a word.
    "R5": ("그사이 상황이 바뀌었어요", "Things changed meanwhile"),
    "R5.line": ("이 요청을 지금 처리할까요?", "Run this request now?"),
    "R5.run": ("처리하기", "Run it"),
    "R5.cancel": ("취소하기", "Cancel it"),
    "R5.unheard": (
        "아직 전하지 못했어요. 잠시 뒤 다시 눌러 주세요.",
        "That did not get through. Please press again in a moment.",
    ),
    # Pressed once more while its receipt waits.
    "R14": ("이미 접수했어요 · 접수 번호: {id}", "Already received · Receipt: {id}"),
    "again": ("5초마다 다시 확인해요.", "This page looks again every 5 seconds."),
    "reopen": ("화면 다시 열기", "Open the page again"),
}

#: Sentences that claim something -> the fact that has to be known before one of them is shown.
FACTS: Final[dict[str, str]] = {
    "R1b": "the gateway counts requests of this browser that wait at it, or says `waiting` of a receipt",
    "R1c": "the gateway has given a receipt (202, or its page) and has not settled it as far as this browser heard",
    "R4.line": "the gateway's receipts, asked for one by one: `done`; `already_done`; `not_done` or `refused`",
    "done": "the gateway's receipt says `done`: the core answered it with 2xx",
    "already_done": "the gateway's receipt says `already_done`: the ledger was asked and holds its key",
    "not_done": "the gateway's receipt says `not_done`: it was cancelled, and it never runs",
    "refused": "the gateway's receipt says `refused`: the core answered it with 4xx",
    "set_aside": "the gateway's receipt says `set_aside`: its trial said so",
    "R5": "the gateway's receipt says `ask`",
    "R14": "the gateway's receipt of the same wish says `waiting`",
}
