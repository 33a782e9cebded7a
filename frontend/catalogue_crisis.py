"""What a browser says while the ledger's server is away: every text of the crisis script and the recovery page.

One catalogue for both: the server prints it into the recovery page, and the script gets it as a module for each
language. A key is the code of a state (R1, R3b, ...) or of a part of it (R1.line). A sentence that claims
something may be shown only from a fact, so each such sentence stands apart from its neighbours and `FACTS` names
what has to be known before it is said. In Korean no particle stands right after a value.
"""

from typing import Final

from frontend.catalogue_problems import READ_ONLY
from frontend.catalogue_receipts import RECEIPTS
from frontend.render import Language

LANGUAGES: Final[tuple[Language, ...]] = ("ko", "en")

#: code -> (ko, en)
CRISIS: Final[dict[str, tuple[str, str]]] = {
    # A request of the page waits although the ledger is being served.
    "R0": ("응답이 늦어지고 있어요", "The server is slow to answer"),
    "R0.line": ("계속 입력해도 괜찮아요.", "You can keep typing."),
    "R0.trial": ("요청을 확인하고 있어요", "Your request is being checked"),
    "R0.trial.line": (
        "잠시만 기다려 주세요. 다시 누르지 않아도 돼요.",
        "It takes a moment. No need to press again.",
    ),
    # The server is away and is being brought back.
    "R1": ("서버를 다시 켜고 있어요", "Restarting the server"),
    "R1.line": (
        "이미 저장된 내역은 디스크에 남아 있어요. 다시 켠 뒤 잔액이 맞는지 확인할게요.",
        "Records already saved are on disk. We will check the balances once it is back.",
    ),
    # What the gateway keeps; whether the window is needed depends on what was promised.
    **{code: RECEIPTS[code] for code in ("R1b", "R1b.line", "R1c")},
    "R1b.open": ("그때까지 창을 닫지 말아 주세요.", "Please keep the window open until then."),
    "R1p": ("이 창에서 기다리는 요청 {n}건", "{n} waiting in this window"),
    "R1p.line": (
        "이 창을 열어 두면 서버가 돌아온 뒤 한 번만 처리해요. 다시 누르지 않아도 돼요.",
        "Keep this window open: each one will be handled once when the server is back. No need to press again.",
    ),
    "R2": ("관리자가 잠시 다시 켜고 있어요", "The administrator is restarting the server"),
    "R2.line": ("고장이 아니에요.", "Nothing is broken."),
    "draft.stored": (
        "쓰던 내용은 이 브라우저에 저장해 뒀어요.",
        "What you were typing is stored in this browser.",
    ),
    "draft.page": (
        "쓰던 내용은 이 화면에 그대로 있어요. 창을 닫지 마세요.",
        "What you were typing is still on this page. Please keep this window open.",
    ),
    # How long.
    "eta.range": ("보통 {a}~{b}초 걸려요", "Usually {a}-{b} seconds"),
    "eta.within": ("보통 {b}초 안에 돌아와요", "Usually back within {b} s"),
    "eta.none": (
        "아직 예상 시간을 계산할 기록이 부족해요",
        "Not enough history for an estimate yet",
    ),
    "elapsed": ("{t}초 지났어요", "{t} s so far"),
    # The four stages, and the word beside each mark.
    "stage.1": ("문제 발견", "Problem found"),
    "stage.2": ("멈춘 서버 정리", "Stopping the old server"),
    "stage.3": ("서버 켜기", "Starting the server"),
    "stage.4": ("잔액 확인", "Checking balances"),
    # The first two of a restart that was asked for.
    "plan.1": ("다시 켜기 요청", "Restart asked for"),
    "plan.2": ("하던 일 마무리", "Finishing what was under way"),
    "mark.done": ("끝남", "done"),
    "mark.passed": ("지나감", "passed"),
    "mark.now": ("하는 중", "now"),
    "mark.next": ("다음", "next"),
    "took": ("{t}초", "{t} s"),
    # It is back.
    "R3": ("다시 사용할 수 있어요", "You are back"),
    "R3.took": ("{t}초 만에 돌아왔어요.", "It took {t} seconds."),
    "R3.verified": ("모든 잔액이 맞는 것을 확인했어요.", "All balances were checked and match."),
    "R3b.line": (
        "잔액 확인은 뒤에서 계속하고 있어요.",
        "Balance check is still running in the background.",
    ),
    "R3c": ("{n}밀리초 동안 끊겼다가 돌아왔어요", "Interrupted for {n} ms"),
    "R3c.seconds": ("{t}초 동안 끊겼다가 돌아왔어요", "Interrupted for {t} seconds"),
    "R3c.verified": ("잃은 내역은 없어요.", "Nothing was lost."),
    # The ledger is served, and takes no changes.
    "R9": ("읽기 전용이에요", "Read-only"),
    "R9.line": (
        "지금은 입력할 수 없어요. 저장된 내역은 볼 수 있어요.",
        "Changes are off for now. You can look at what is stored.",
    ),
    # In the words in which a refused change is answered.
    **{f"R9.{why}": (said["ko"], said["en"]) for why, said in READ_ONLY.items() if why.startswith("DISK_")},
    "R10": ("잔액이 맞지 않는 부분을 찾았어요", "A balance does not match"),
    "R10.safe": (
        "더 틀어지지 않도록 입력을 막았어요.",
        "Changes are blocked so it cannot get worse.",
    ),
    "R10.line": ("관리자 확인이 필요해요.", "The administrator must look at it."),
    # It takes longer, or nobody tries any more.
    "R7": ("평소보다 오래 걸리고 있어요", "Taking longer than usual"),
    "R7.stage": ("지금 단계: {stage}.", "Current step: {stage}."),
    "R7.alerted": (
        "{t} 관리자에게 알림을 보냈어요.",
        "The administrator was alerted at {t}.",
    ),
    "R7b.line": (
        "알림을 보내지 못했어요. 서버 관리자에게 직접 알려 주세요.",
        "No alert could be sent. Please tell the person who runs this server.",
    ),
    "R8": ("자동 복구를 멈췄어요", "Automatic recovery has stopped"),
    "R8.line": (
        "내역을 지키려고 멈췄어요. 저장된 내역은 건드리지 않았어요. 서버 관리자에게 알려 주세요.",
        "It stopped to protect your records. Saved records were not touched. Please tell the person who runs this server.",
    ),
    "R8.next": (
        "관리자: 서버에서 hardcore incidents 명령으로 이유를 보고, hardcore resume 명령으로 다시 켜요.",
        "Administrator: on the server, hardcore incidents says why and hardcore resume tries again.",
    ),
    "R8.admin": ("관리자 화면", "Administrator"),
    "OFF": ("서버가 꺼져 있어요", "The server is switched off"),
    "OFF.line": (
        "관리자가 껐어요. 이미 저장된 내역은 디스크에 남아 있어요.",
        "It was stopped by the person who runs it. Records already saved are on disk.",
    ),
    "OFF.next": (
        "관리자: 서버에서 hardcore up 명령으로 다시 켜요.",
        "Administrator: on the server, hardcore up starts it again.",
    ),
    # This browser can't reach the server at all.
    "R11": ("서버와 연결이 끊겼어요", "No connection to the server"),
    "R11.line": (
        "이 기기의 인터넷이나 와이파이를 확인해 주세요.",
        "Check this device's internet or Wi-Fi.",
    ),
    "R11.silent": ("서버가 대답하지 않아요", "The server does not answer"),
    "R11.silent.line": (
        "이 기기의 인터넷을 확인하고, 계속되면 서버 관리자에게 알려 주세요.",
        "Check this device's connection. If it lasts, please tell the person who runs this server.",
    ),
    "R11.kept": ("쓰던 내용은 그대로 있어요.", "What you typed is still here."),
    "R12": ("다시 로그인해 주세요", "Please sign in again"),
    "R12.line": (
        "로그인하면 이어서 쓸 수 있어요.",
        "You can go on after that.",
    ),
    "R12.do": ("로그인", "Sign in"),
    "R11.back": ("다시 연결됐어요", "Connected again"),
    # Drafts.
    "R13": ("쓰던 내용을 되살렸어요", "Restored what you typed"),
    "R13.unsent": ("아직 보내지 않았어요.", "It has not been sent."),
    "R13.tried": (
        "보내졌는지 내역에서 확인해 주세요.",
        "Please check the records to see whether it was sent.",
    ),
    "undo": ("되돌리기", "Undo"),
    "keep": ("쓰던 내용 복사하기", "Copy my text"),
    "keep.done": ("복사했어요", "Copied"),
    "keep.byhand": ("아래 글을 직접 복사해 주세요.", "Please copy the text below by hand."),
    # The recovery page alone.
    "R15.line": ("5초마다 자동으로 다시 열어요.", "This page reopens every 5 seconds."),
    "reopens": (
        "서버가 돌아오면 이 화면이 저절로 열려요.",
        "This page opens by itself when the server is back.",
    ),
    "not_done.line": ("방금 보낸 요청은 처리하지 않았어요.", "What you just sent was not done."),
    "not_done.wait": (
        "서버가 돌아오면 화면을 다시 열고 한 번 더 보내 주세요.",
        "When the server is back, open the page again and send it once more.",
    ),
    "not_done.now": (
        "화면을 다시 열고 한 번 더 보내 주세요.",
        "Please open the page again and send it once more.",
    ),
    "unknown.line": (
        "방금 보낸 요청이 처리됐는지 아직 알 수 없어요.",
        "It is not known whether what you just sent was done.",
    ),
    "unknown.wait": (
        "서버가 돌아오면 먼저 내역을 확인해 주세요.",
        "When the server is back, please check the records first.",
    ),
    "unknown.now": ("먼저 내역을 확인해 주세요.", "Please check the records first."),
    "reopen": RECEIPTS["reopen"],
    "keepable.line": (
        "방금 보낸 요청은 아직 처리하지 않았어요.",
        "What you just sent has not been done yet.",
    ),
    "keepable.wait": (
        "맡겨 두면 서버가 돌아온 뒤 한 번만 처리해요. 그다음에는 이 창을 닫아도 돼요.",
        "Leave it here and it will be handled once when the server is back. You can close this window then.",
    ),
    "keepable.now": (
        "맡기면 지금 한 번만 처리해요.",
        "Leave it here and it will be handled once, now.",
    ),
    "keepable.do": ("요청 맡겨 두기", "Keep it for me"),
    "doubtful.line": (
        "방금 보낸 요청이 처리됐는지 아직 알 수 없어요.",
        "It is not known whether what you just sent was done.",
    ),
    "doubtful.wait": (
        "맡겨 두면 서버가 돌아온 뒤 내역을 먼저 확인하고, 없을 때만 한 번 처리해요. 그다음에는 이 창을 닫아도 돼요.",
        "Leave it here: once the server is back, it is done if it was not yet. You can close this window then.",
    ),
    "doubtful.now": (
        "맡기면 지금 내역을 먼저 확인하고, 없을 때만 한 번 처리해요.",
        "Leave it here: the records are checked now, and it is done if it was not yet.",
    ),
    "back.line": (
        "브라우저의 뒤로 가기를 누르면 쓰던 내용이 남아 있을 수 있어요.",
        "Your browser's Back button may bring back what you typed.",
    ),
    # Small words.
    "details": ("자세히", "Details"),
    "close": ("닫기", "Close"),
    "state": ("상태: {phase}", "State: {phase}"),
    "incident": ("사건 번호: {id}", "Incident: {id}"),
    "title.down": ("(복구 중)", "(Recovering)"),
    "title.stopped": ("(멈춤)", "(Stopped)"),
    "title.off": ("(꺼짐)", "(Off)"),
    "title.back": ("✓", "✓"),
    "other": ("English", "한국어"),
    # What the guard calls it, for those who open the details.
    "phase.UNKNOWN": ("아직 알 수 없음", "not known yet"),
    "phase.STOPPED": ("꺼져 있음", "off"),
    "phase.ADOPTING": ("남아 있던 서버를 정리하는 중", "ending what was left over"),
    "phase.STARTING": ("새 서버를 켜는 중", "starting a new server"),
    "phase.PROVING": ("잔액을 확인하는 중", "checking the balances"),
    "phase.PROBATION": ("켜졌고 지켜보는 중", "up, and being watched"),
    "phase.RUNNING": ("켜져 있음", "up"),
    "phase.SUSPECT": ("켜져 있지만 걱정되는 점이 있음", "up, with a worry"),
    "phase.DRAINING": ("하던 일을 마치는 중", "finishing what was under way"),
    "phase.SNAPSHOT_LIVE": ("원인을 기록하는 중", "saving the cause"),
    "phase.STOPPING": ("하던 일을 마치는 중", "finishing what was under way"),
    "phase.SWITCHING": ("대기하던 서버가 이어받는 중", "the spare server is taking over"),
    "phase.KILLING": ("멈춘 서버를 끝내는 중", "ending the old server"),
    "phase.UNKILLABLE": ("멈춘 서버가 아직 끝나지 않음", "the old server has not ended yet"),
    "phase.BACKOFF": ("다시 켜기 전에 잠시 기다리는 중", "waiting a moment before the next start"),
    "phase.FATAL": ("자동 복구를 멈춤", "automatic recovery has stopped"),
}

#: Sentences that claim something -> the fact that has to be known before one of them is shown.
FACTS: Final[dict[str, str]] = {
    "R0": "a request of this page waits while the last state says that the ledger is served",
    "R0.trial": "the last state counts requests of this browser that wait for a trial while the ledger is served",
    "R1b": "the gateway counts held requests of this browser",
    "R1c": "the state frame counts a receipt that waits, and a receipt frame named it",
    "R1p": "the page counts requests that wait in it",
    "R2": "the state frame's text is R2: the guard was asked for this restart",
    "draft.stored": "every field typed into was written to the storage and read back the same",
    "draft.page": "a field of the living page was typed into",
    "eta.none": "the state frame has no eta and names fewer than five samples",
    "eta.range": "the state frame has an eta, which takes five samples",
    "eta.within": "the state frame has an eta, which takes five samples",
    "R3.took": "the outage's length: from the back frame, counted on from the guard's own elapsed time, or how long our own line was gone",
    "R3.verified": "proof B of the serving epoch: verified is true",
    "R3b.line": "proof B has not spoken: verified is null",
    "R3c": "the outage's length: from the back frame, counted on from the guard's own elapsed time, or how long our own line was gone",
    "R3c.seconds": "the outage's length: from the back frame, counted on from the guard's own elapsed time, or how long our own line was gone",
    "R3c.verified": "proof B of the serving epoch: verified is true",
    "R9": "the state frame's text is null and its safe names a diagnosis: the core refuses changes and serves reads",
    "R10": "proof B found a fault: ok, verified or sound is false, or safe is STORE_CORRUPT",
    "R10.safe": "the state frame's safe names a diagnosis: the core refuses changes",
    "R7.alerted": "the state frame's alerted_at: somebody's channel has taken the message",
    "R7b.line": "the state frame's text is R7b: no alert was delivered",
    "R8": "the state frame's text is R8: the guard has stopped trying",
    "OFF": "the state frame's text is OFF: the operator stopped it",
    "R11": "the socket is gone and status.json can't be fetched",
    "R11.silent": "the same, and it was not refused: no answer came in time",
    "R12": "the gateway has answered this browser 401: it knows no session of it",
    "R11.kept": "the page that was typed into is still alive",
    "R13": "a field was filled from the storage",
    "R13.unsent": "the form was not submitted since the draft was written",
    "keep.done": "the clipboard took it",
    "not_done.line": "the gateway never sent the request to a core",
    "keepable.line": "the gateway never sent the request to a core",
    "unknown.line": "the core died before it answered",
    "doubtful.line": "the core died before it answered",
}


def words(lang: Language) -> dict[str, str]:
    """Return every text in one language, by its code."""
    which = LANGUAGES.index(lang)
    return {code: texts[which] for code, texts in CRISIS.items()}
