"""What the demo's page says: what each button breaks, what to watch, and what has happened since.

The page exists only behind `hardcore up --demo`. It says before each button what will be done to the server, and
afterwards only what the page itself has seen or was told. In Korean no particle stands right after a value.
"""

from typing import Final

from frontend.render import Language

#: The faults in the order of the page, as `POST /__hc/drill/{fault}` names them.
FAULTS: Final = ("crash", "freeze", "block", "exit")

#: code -> (ko, en)
DEMO: Final[dict[str, tuple[str, str]]] = {
    "title": ("망가뜨려 보기", "Break it and watch"),
    "lead": (
        "이 화면은 가계부 서버를 일부러 망가뜨려요. 연습이 아니라 진짜 고장이에요. 가계부를 옆에 열어 두고 두 화면을 함께 보세요.",
        "This page breaks the ledger's server on purpose. The faults are real ones. Keep the ledger open beside it and watch both.",
    ),
    "ledger": ("가계부 열기", "Open the ledger"),
    "faults": ("무엇을 망가뜨릴까요", "What shall break"),
    "crash": ("죽이기", "Crash"),
    "crash.will": (
        "서버가 하던 일을 끝내지 못하고 그 자리에서 죽어요.",
        "The server dies on the spot, in the middle of whatever it does.",
    ),
    "crash.watch": (
        "보통 1초 안에 돌아와요. 화면이 그 사이를 먼저 알려 줘요.",
        "It is usually back within a second. The page says so before you ask.",
    ),
    "freeze": ("얼리기", "Freeze"),
    "freeze.will": (
        "서버가 살아 있는 채로 멈춰요. 연결은 열려 있지만 아무 대답도 없어요.",
        "The server stops while it is alive. Its connections stay open and nobody answers.",
    ),
    "freeze.watch": (
        "멈춘 것을 알아채고, 증거를 남기고, 새로 켜는 단계를 보세요.",
        "Watch the stages: noticed, evidence kept, a new one started.",
    ),
    "block": ("막기", "Block"),
    "block.will": (
        "서버의 한 부분이 끝나지 않는 일에 붙잡혀요. 나머지는 멀쩡해 보여요.",
        "One part of the server waits for something that never ends. The rest looks well.",
    ),
    "block.watch": (
        "가장 알아채기 어려운 고장이에요. 그래도 몇 초를 넘기지 않아요.",
        "This is the hardest to notice, and still a matter of seconds.",
    ),
    "exit": ("말없이 나가기", "Leave without a word"),
    "exit.will": (
        "서버가 아무도 시키지 않았는데 스스로 꺼져요.",
        "The server ends by itself, unasked, as if all were well.",
    ),
    "exit.watch": (
        "꺼져 있어야 할 때가 아니라는 것을 알고 다시 켜요.",
        "It is started again, because nobody wanted it to be off.",
    ),
    "later": (
        "3초 뒤에 (그동안 아래에 글을 쓸 수 있어요)",
        "After 3 seconds, so that you can be typing below",
    ),
    "meanwhile": ("그동안 해 보기", "Meanwhile"),
    "typing": (
        "여기에 아무 글이나 쓰면서 버튼을 눌러 보세요",
        "Type something here, and press a button above",
    ),
    "typing.hint": (
        "서버가 멈췄다 돌아와도 글과 커서가 그대로 있는지 보세요.",
        "See that the text and the cursor are where they were when the server is back.",
    ),
    "send": ("커피 한 잔 적기 (3,500원)", "Book a coffee (3,500 won)"),
    "send.hint": (
        "서버가 없는 동안 눌러 보세요. 기다렸다가 한 번만 적어요.",
        "Press it while the server is away. It waits, and is booked once.",
    ),
    # These stay in the ledger, where both languages read them: one name each, or the other page makes a second.
    "coffee": ("데모 커피 · Demo coffee", "데모 커피 · Demo coffee"),
    "category": ("카페 · Café", "카페 · Café"),
    "method": ("지갑 · Wallet", "지갑 · Wallet"),
    "log": ("있었던 일", "What happened"),
    "log.empty": ("아직 아무 일도 없었어요.", "Nothing yet."),
    "log.pressed": ("버튼을 눌렀어요: {fault}", "You pressed: {fault}"),
    "log.soon": ("3초 뒤에: {fault}", "In 3 seconds: {fault}"),
    "log.refused": ("지금은 할 수 없어요: {why}", "Not now: {why}"),
    "log.down": (
        "서버가 대답하지 않아요. 화면이 먼저 알았어요.",
        "The server does not answer; the page was told.",
    ),
    "log.stage": ("단계 {stage}: {name}", "Stage {stage}: {name}"),
    "log.back": ("돌아왔어요. {ms} ms 동안 멈췄어요.", "Back after {ms} ms."),
    "log.again_there": ("돌아왔어요.", "It is back."),
    "log.planned": ("계획된 재시작이에요.", "This restart was planned."),
    "log.sent": ("커피를 보냈어요.", "The coffee was sent."),
    "log.booked": ("커피가 적혔어요. {ms} ms 걸렸어요.", "The coffee is booked. That took {ms} ms."),
    "log.once": ("장부에서 찾아보니 {n}건이에요.", "Found in the ledger: {n}."),
    "log.again": (
        "아직 적히지 않았어요. 같은 번호로 다시 보내요.",
        "Not booked yet. It is sent again under the same key.",
    ),
    "log.failed": ("적지 못했어요: {why}", "It was not booked: {why}"),
    "stage.1": ("문제 발견", "problem found"),
    "stage.2": ("멈춘 서버 정리", "stopping the old server"),
    "stage.3": ("서버 켜기", "starting the server"),
    "stage.4": ("잔액 확인", "checking balances"),
    "language": ("English", "한국어"),
    "no_script": (
        "이 화면은 자바스크립트가 있어야 해요. 터미널에서는 `hardcore drill crash`를 쓰세요.",
        "This page needs JavaScript. In a terminal there is `hardcore drill crash`.",
    ),
    "offline": ("서버에 닿지 못했어요", "the server could not be reached"),
}


def words(lang: Language) -> dict[str, str]:
    """Return every text of the page in one language."""
    return {code: text[0 if lang == "ko" else 1] for code, text in DEMO.items()}
