"""What the ledger says when it can't simply answer: title and detail of each problem, in Korean and English.

Plain data, so that a translator can read it and a test can hold it against the closed list of problems. A
detail may name values in braces; in Korean no particle stands directly after one, because the right particle
would depend on the value.
"""

from typing import Final

from frontend import catalogue_pending, catalogue_plans

#: slug -> language -> (title, detail)
PROBLEMS: Final[dict[str, dict[str, tuple[str, str]]]] = {
    "malformed-json": {
        "ko": ("JSON 형식이 잘못됐어요", "본문을 읽을 수 없어요. 위치: {position}번째 바이트 근처."),
        "en": ("This is not valid JSON", "The body cannot be read near byte {position}."),
    },
    "body-too-large": {
        "ko": ("보낸 내용이 너무 커요", "한 번에 {limit_bytes}바이트까지 받아요. 나누어 보내 주세요."),
        "en": (
            "What was sent is too large",
            "Up to {limit_bytes} bytes are taken at once. Please send it in parts.",
        ),
    },
    "invalid-key": {
        "ko": (
            "멱등성 키를 쓸 수 없어요",
            "Idempotency-Key 헤더에는 공백 없는 ASCII 문자 1~255개만 쓸 수 있어요.",
        ),
        "en": (
            "This idempotency key cannot be used",
            "Idempotency-Key takes 1 to 255 visible ASCII characters.",
        ),
    },
    "invalid-parameter": {
        "ko": ("주소의 조건이 잘못됐어요", "errors에 있는 조건을 고쳐 주세요."),
        "en": ("A parameter is not usable", "Please correct the parameters named in errors."),
    },
    "export-format-unknown": {
        "ko": ("이 형식으로는 내보낼 수 없어요", "format에 다음 중 하나를 골라 주세요: {formats}."),
        "en": (
            "The ledger cannot be exported in this format",
            "Please choose one of these as format: {formats}.",
        ),
    },
    "invalid-body": {
        "ko": ("고쳐야 할 항목이 있어요", "errors에 있는 항목을 고쳐서 다시 보내 주세요."),
        "en": (
            "Some fields need to be corrected",
            "Please correct the fields named in errors and send it again.",
        ),
    },
    "unbalanced": {
        "ko": ("차변과 대변이 맞지 않아요", "{currency} 합계가 0이어야 해요. 차이: {off_by}."),
        "en": (
            "The postings do not balance",
            "The postings in {currency} must add up to zero; they are off by {off_by}.",
        ),
    },
    "unknown-account": {
        "ko": ("없는 계정이에요", "먼저 계정을 만들어 주세요: {account}."),
        "en": ("There is no such account", "Please open it first: {account}."),
    },
    "account-exists": {
        "ko": ("이미 있는 계정이에요", "다른 이름을 골라 주세요. 이미 있는 이름: {account}."),
        "en": ("This account exists already", "Please choose another id than {account}."),
    },
    "account-closed": {
        "ko": ("닫힌 계정이에요", "닫힌 계정에는 기록할 수 없어요: {account}."),
        "en": ("This account is closed", "A closed account takes no more postings: {account}."),
    },
    "currency-differs": {
        "ko": ("통화가 달라요", "{account} 계정의 통화: {currency}. 보낸 통화: {given}."),
        "en": ("The currency differs", "{account} is kept in {currency}, not in {given}."),
    },
    "overdraft": {
        "ko": (
            "잔액이 부족해요",
            "{account} 계정에서 이 거래 뒤의 잔액: {balance} {currency}. 이 계정은 0 아래로 내려갈 수 없어요.",
        ),
        "en": (
            "The balance does not suffice",
            "{account} would stand at {balance} {currency} and may not be overdrawn.",
        ),
    },
    "balance-out-of-range": {
        "ko": ("금액이 너무 커요", "{account} 계정이 담을 수 있는 금액을 넘어요."),
        "en": ("The amount is too large", "It is more than {account} can hold."),
    },
    "currency-needed": {
        "ko": ("통화를 알 수 없어요", "currency에 통화 코드를 적어서 다시 보내 주세요. 예: KRW."),
        "en": ("The currency is not clear", "Please name it in currency, for example KRW."),
    },
    "not-a-money-account": {
        "ko": (
            "돈이 오가는 계정이 아니에요",
            "자산이나 부채 계정을 골라 주세요. 보낸 계정: {account}.",
        ),
        "en": (
            "No money is kept in this account",
            "Please choose an asset or a liability instead of {account}.",
        ),
    },
    "entry-not-found": {
        "ko": ("없는 내역이에요", "지워졌거나 주소가 달라요."),
        "en": ("There is no such entry", "It was deleted, or the address is another one."),
    },
    "entry-reversed": {
        "ko": ("이미 지운 내역이에요", "지운 내역은 바꿀 수 없어요. 필요하면 새로 적어 주세요."),
        "en": (
            "This entry has been deleted",
            "It can no longer be changed. If you need it, write a new one.",
        ),
    },
    "entry-changed": {
        "ko": (
            "그사이에 바뀐 내역이에요",
            "다른 화면에서 먼저 바꿨어요. 지금 내용을 확인하고 다시 해 주세요.",
        ),
        "en": (
            "This entry has been changed meanwhile",
            "Somebody changed it first. Please look at what it says now and try again.",
        ),
    },
    "already-imported": {
        "ko": ("이미 가져온 내역이에요", "같은 줄이 장부에 있어서 다시 적지 않았어요."),
        "en": ("This row is in the ledger already", "It was not written down a second time."),
    },
    **catalogue_pending.PROBLEMS,
    **catalogue_plans.PROBLEMS,
    "key-reused": {
        "ko": (
            "이미 다른 요청에 쓴 키예요",
            "같은 멱등성 키로 다른 내용을 보낼 수 없어요. 새 키를 써 주세요.",
        ),
        "en": (
            "This key belongs to another request",
            "An idempotency key stands for one request. Please use a new key.",
        ),
    },
    "subprotocol-unknown": {
        "ko": ("이 연결의 말을 몰라요", "이 소켓에서는 {subprotocol} 프로토콜을 써요."),
        "en": ("This socket speaks something else", "Offer the subprotocol {subprotocol}."),
    },
    "foreign-page": {
        "ko": ("다른 사이트의 페이지는 연결할 수 없어요", "가계부 주소에서 직접 열어 주세요."),
        "en": ("A page of another site may not connect", "Please open the ledger at its own address."),
    },
    "not-found": {
        "ko": ("여기에는 아무것도 없어요", "주소를 확인해 주세요."),
        "en": ("There is nothing here", "Please check the address."),
    },
    "import-not-found": {
        "ko": ("없는 가져오기예요", "오래된 미리보기는 지워져요. 파일을 다시 올려 주세요."),
        "en": ("There is no such import", "Old previews are removed. Please upload the file again."),
    },
    "malformed-upload": {
        "ko": ("올린 내용을 읽을 수 없어요", "파일 하나를 골라 다시 올려 주세요."),
        "en": ("The upload cannot be read", "Please choose one file and upload it again."),
    },
    "file-too-large": {
        "ko": ("파일이 너무 커요", "{limit_mb} MB까지 올릴 수 있어요. 기간을 나누어 내려받아 주세요."),
        "en": ("The file is too large", "Up to {limit_mb} MB. Please download a shorter period at a time."),
    },
    "file-unreadable": {
        "ko": ("파일을 읽지 못했어요", "{sentence}"),
        "en": ("The file could not be read", "{sentence}"),
    },
    "import-committed": {
        "ko": ("이미 가져오기를 시작했어요", "다르게 가져오려면 파일을 다시 올려 주세요."),
        "en": ("This import has been committed", "To import it differently, please upload the file again."),
    },
    "import-mapping": {
        "ko": ("칸을 더 정해야 해요", "{sentence}"),
        "en": ("The columns are not settled yet", "{sentence}"),
    },
    "import-without-account": {
        "ko": ("계좌를 골라 주세요", "어느 계좌의 내역인지 알아야 가져올 수 있어요."),
        "en": ("Please choose an account", "The rows can only be booked on the account they belong to."),
    },
    "import-not-kept": {
        "ko": ("파일을 보관하지 못했어요", "디스크에 빈 자리가 있는지 확인하고 다시 해 주세요."),
        "en": ("The file could not be kept", "Please check that the disk has room, then try again."),
    },
    "import-format-unknown": {
        "ko": ("모르는 파일 형식이에요", "찾은 이름: {format}."),
        "en": ("This format is not known", "No format is called {format}."),
    },
    "account-not-found": {
        "ko": ("없는 계정이에요", "찾은 이름: {account}."),
        "en": ("There is no such account", "No account is called {account}."),
    },
    "transaction-not-found": {
        "ko": ("없는 거래예요", "찾은 번호: {transaction}."),
        "en": ("There is no such transaction", "No transaction has the id {transaction}."),
    },
    "command-not-found": {
        "ko": ("이 키로 처리된 요청이 없어요", "이 키의 요청은 처리되지 않았어요."),
        "en": ("No request under this key", "No request with this key has been done."),
    },
    "method-not-allowed": {
        "ko": ("이 방식은 쓸 수 없어요", "여기서 쓸 수 있는 방식: {allowed}."),
        "en": ("This method is not used here", "Here one may use: {allowed}."),
    },
    "busy": {
        "ko": ("지금은 요청이 너무 많아요", "이 요청은 처리하지 않았어요. 잠시 뒤에 다시 보내 주세요."),
        "en": (
            "Too many requests at this moment",
            "This request was not done. Please send it again in a moment.",
        ),
    },
    "leaving": {
        "ko": ("서버가 내려가는 중이에요", "이 요청은 처리하지 않았어요. 잠시 뒤에 다시 보내 주세요."),
        "en": ("The server is shutting down", "This request was not done. Please send it again in a moment."),
    },
    "store-busy": {
        "ko": ("장부가 다른 작업에 잠겨 있어요", "이 요청은 처리하지 않았어요. 잠시 뒤에 다시 보내 주세요."),
        "en": (
            "Something else holds the ledger's lock",
            "This request was not done. Please send it again in a moment.",
        ),
    },
    "safe-mode": {
        "ko": ("지금은 읽기만 할 수 있어요", "지금은 입력을 받지 않아요. {why}"),
        "en": ("Read-only for now", "No changes are taken for now. {why}"),
    },
    "store-unreadable": {
        "ko": ("지금은 장부를 읽을 수 없어요", "잠시 뒤에 다시 시도해 주세요."),
        "en": ("The ledger cannot be read right now", "Please try again in a moment."),
    },
    "read-too-long": {
        "ko": ("찾는 데 너무 오래 걸려요", "기간이나 계정을 좁혀서 다시 찾아 주세요."),
        "en": ("This search takes too long", "Please narrow the dates or name an account."),
    },
    "outcome-unknown": {
        "ko": (
            "처리됐는지 아직 알 수 없어요",
            "저장하는 중에 문제가 생겼어요. Idempotency-Key와 함께 보냈다면 그대로 다시 보내도 한 번만 처리돼요. 없었다면 먼저 내역을 확인해 주세요.",
        ),
        "en": (
            "It is not known whether this was done",
            "Storing it failed half-way. If you sent it with an Idempotency-Key, send it again as it was: it is done once. If not, please check the records first.",
        ),
    },
    "set-aside": {
        "ko": (
            "이 요청은 따로 보관해 두었어요",
            "장부에 기록하지 않았어요. 서버를 관리하는 분이 살펴보고 다시 처리할 수 있어요. 번호: {letter}.",
        ),
        "en": (
            "This request has been set aside",
            "It was not booked. Whoever runs this server can look at it and have it done again. Number: {letter}.",
        ),
    },
    "account-set-aside": {
        "ko": (
            "이 계정에는 지금 기록할 수 없어요",
            "이 계정의 기록 하나를 따로 보관해 두었어요. 내역은 그대로 볼 수 있어요. 계정: {account}. 번호: {letter}.",
        ),
        "en": (
            "Nothing can be booked on this account for now",
            "One of its records has been set aside. It can be read as before. Account: {account}. Number: {letter}.",
        ),
    },
    "partly-done": {
        "ko": (
            "앞부분만 처리했어요",
            "나머지는 따로 보관해 둔 기록이 있어서 하지 않았어요. 내역을 먼저 확인해 주세요. 번호: {letter}.",
        ),
        "en": (
            "Only the first part was done",
            "The rest was not, because a record it needs has been set aside. Please check the records first. Number: {letter}.",
        ),
    },
    "limited": {
        "ko": (
            "지금은 이런 요청을 더 받지 않아요",
            "1분에 받는 수나 크기를 정해 둔 규칙이 있어요. 아무것도 기록하지 않았어요. 규칙: {rule}.",
        ),
        "en": (
            "No more of these are taken for now",
            "A rule limits how many of them are taken in a minute, or how large one may be. Nothing was booked. Rule: {rule}.",
        ),
    },
    "internal": {
        "ko": ("서버 오류예요", "저희 쪽 문제예요. 다시 보내기 전에 내역을 확인해 주세요."),
        "en": (
            "The server made a mistake",
            "The fault is ours. If you sent it with an Idempotency-Key, send it again as it was: it is done once. If not, please check the records first.",
        ),
    },
}

#: Why only reads are served: diagnosis -> language -> sentence. The empty one is for every other diagnosis.
READ_ONLY: Final[dict[str, dict[str, str]]] = {
    "DISK_FULL": {
        "ko": "장부가 있는 디스크가 가득 찼어요.",
        "en": "The disk that holds the ledger is full.",
    },
    "DISK_READ_ONLY": {
        "ko": "장부가 있는 디스크에 쓸 수 없어요.",
        "en": "The disk that holds the ledger cannot be written to.",
    },
    "DISK_STALLED": {
        "ko": "장부가 있는 디스크가 대답하지 않아요.",
        "en": "The disk that holds the ledger does not answer.",
    },
    "OPERATOR": {
        "ko": "서버를 관리하는 분이 읽기 전용으로 바꿔 두었어요.",
        "en": "Whoever runs this server has made it read-only for now.",
    },
    "STORE_CORRUPT": {
        "ko": "장부에서 맞지 않는 부분을 찾았어요. 더 틀어지지 않도록 입력을 막았어요.",
        "en": "Something in the ledger does not match. Changes are blocked so it cannot get worse.",
    },
    "": {
        "ko": "서버가 지금은 입력을 받지 않아요.",
        "en": "The server takes no changes for now.",
    },
}
