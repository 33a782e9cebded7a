"""What the gateway says when it answers itself: title and detail of each problem, in Korean and English.

Plain data, so that a translator can read it and a test can hold it against the gateway's closed list of
problems. A sentence may say only what the gateway knows when it sends it.
"""

#: The number of what was set aside, by language.
NUMBER: dict[str, str] = {"ko": "번호: {id}", "en": "Number: {id}"}

#: The same for some of which nobody knows whether it was done, wholly or in part.
DOUBTFUL: dict[str, dict[str, tuple[str, str]]] = {
    "set-aside": {
        "ko": (
            "이 요청은 따로 보관했어요",
            "처리 중에 서버가 멈춘 요청이라 더는 시도하지 않아요. 이미 처리된 부분이 있을 수 있으니 내역을 확인해 주세요. 서버 관리자에게 번호를 알려 주세요.",
        ),
        "en": (
            "This request was set aside",
            "The server stopped while handling it, so it is not tried any more. Some of it may have been done: please check the records, and tell the administrator its number.",
        ),
    },
    "source-stopped": {
        "ko": (
            "이 브라우저의 입력을 잠시 멈췄어요",
            "여기에서 보낸 요청 때문에 서버가 여러 번 멈췄어요. 보기는 할 수 있어요. 이 요청이 전에 처리됐는지는 내역에서 확인해 주세요.",
        ),
        "en": (
            "Changes from here are paused",
            "Requests sent from here stopped the server several times. You can still look at everything. Please check the records for whether this request was done before.",
        ),
    },
}

#: slug -> language -> (title, detail)
PROBLEMS: dict[str, dict[str, tuple[str, str]]] = {
    "bad-request": {
        "ko": (
            "요청을 읽을 수 없어요",
            "요청 형식이 HTTP 규칙에 맞지 않아요. 보낸 프로그램을 확인해 주세요.",
        ),
        "en": (
            "This request cannot be read",
            "It does not follow the rules of HTTP. Please check the program that sent it.",
        ),
    },
    "refused-path": {
        "ko": (
            "이 주소는 잠시 받지 않아요",
            "이 주소의 요청을 읽다가 접속을 맡은 부분이 두 번 멈췄어요. 10분이 지나면 다시 받아요. 이 요청은 처리되지 않았어요.",
        ),
        "en": (
            "This address is refused for a while",
            "The gateway has died twice while it read a request for it. It is taken again after ten minutes. This request was not done.",
        ),
    },
    "wrong-host": {
        "ko": (
            "이 주소로는 열 수 없어요",
            "이 서버가 모르는 이름으로 요청이 왔어요. 관리자가 이름을 허용해야 해요.",
        ),
        "en": (
            "Not served under this name",
            "The request names a host that this server does not know. The administrator has to allow it.",
        ),
    },
    "foreign-page": {
        "ko": (
            "다른 사이트에서 온 요청은 받지 않아요",
            "이 가계부를 바꾸는 요청은 이 주소의 화면이나 프로그램에서만 보낼 수 있어요.",
        ),
        "en": (
            "Requests from another site are not taken",
            "Only pages of this address, or a program of yours, may change this ledger.",
        ),
    },
    "not-found": {
        "ko": ("이 주소에는 아무것도 없어요", "주소를 다시 확인해 주세요."),
        "en": ("There is nothing at this address", "Please check the address."),
    },
    "method-not-allowed": {
        "ko": ("이 방식은 쓸 수 없어요", "여기서 쓸 수 있는 방식은 Allow 헤더에 있어요."),
        "en": ("This method is not used here", "The methods that are used here stand in the Allow header."),
    },
    "request-timeout": {
        "ko": ("요청이 끝까지 오지 않았어요", "정해진 시간 안에 다 받지 못했어요. 다시 보내 주세요."),
        "en": (
            "The request did not arrive in full",
            "It was not complete in time. Please send it again.",
        ),
    },
    "body-too-large": {
        "ko": ("보낸 내용이 너무 커요", "정해진 크기를 넘어서 받지 않았어요. 나누어 보내 주세요."),
        "en": (
            "What was sent is too large",
            "It is over the limit and was not accepted. Please send it in smaller parts.",
        ),
    },
    "expectation-failed": {
        "ko": ("이 조건은 지킬 수 없어요", "Expect 헤더에는 100-continue만 쓸 수 있어요."),
        "en": ("This expectation cannot be met", "The Expect header may only say 100-continue."),
    },
    "head-too-large": {
        "ko": ("요청 머리글이 너무 커요", "헤더나 쿠키를 줄여서 다시 보내 주세요."),
        "en": ("The request's headers are too large", "Please send it again with fewer headers or cookies."),
    },
    "gateway-fault": {
        "ko": ("서버 앞단에서 오류가 났어요", "이 연결에서만 생긴 오류예요. 처리됐는지 먼저 확인해 주세요."),
        "en": (
            "The gateway made a mistake",
            "Only this connection is concerned. Please check whether the request was done before you send it again.",
        ),
    },
    "broken-answer": {
        "ko": ("서버의 응답이 온전하지 않아요", "응답을 읽을 수 없었어요. 처리됐는지 먼저 확인해 주세요."),
        "en": (
            "The server's answer was broken",
            "It could not be read. Please check whether the request was done before you send it again.",
        ),
    },
    "recovering": {
        "ko": ("서버를 다시 켜고 있어요", "이 요청은 처리하지 않았어요. 잠시 뒤에 다시 보내 주세요."),
        "en": (
            "The server is being restarted",
            "This request was not done. Please send it again in a moment.",
        ),
    },
    "not-done": {
        "ko": (
            "이 요청은 처리되지 않았어요",
            "서버가 멈췄다가 다시 켜졌고, 장부에 이 요청이 없는 것을 확인했어요.",
        ),
        "en": (
            "This request was not done",
            "The server stopped and is back; the ledger was checked and does not hold this request.",
        ),
    },
    "outcome-unknown": {
        "ko": (
            "처리됐는지 아직 알 수 없어요",
            "응답하기 전에 서버가 멈췄어요. Idempotency-Key와 함께 보냈다면 그대로 다시 보내도 한 번만 처리돼요. 없었다면 먼저 내역을 확인해 주세요.",
        ),
        "en": (
            "It is not known whether this was done",
            "The server stopped before it answered. If you sent it with an Idempotency-Key, send it again as it was: it is done once. If not, please check the records first.",
        ),
    },
    "not-serving": {
        "ko": (
            "지금은 서버를 쓸 수 없어요",
            "자동 복구를 멈췄어요. 이 요청은 처리하지 않았어요. 관리자 확인이 필요해요.",
        ),
        "en": (
            "The server is not available",
            "Automatic recovery has stopped. This request was not done. The administrator must look at it.",
        ),
    },
    "shutting-down": {
        "ko": ("서버를 끄고 있어요", "이 요청은 처리하지 않았어요."),
        "en": ("The server is being shut down", "This request was not done."),
    },
    "too-busy": {
        "ko": ("기다리는 요청이 너무 많아요", "이 요청은 처리하지 않았어요. 잠시 뒤에 다시 보내 주세요."),
        "en": (
            "Too many requests are waiting",
            "This request was not done. Please send it again in a moment.",
        ),
    },
    "core-too-slow": {
        "ko": (
            "서버가 제시간에 답하지 않았어요",
            "Idempotency-Key와 함께 보냈다면 그대로 다시 보내도 한 번만 처리돼요. 없었다면 먼저 내역을 확인해 주세요.",
        ),
        "en": (
            "The server did not answer in time",
            "If you sent it with an Idempotency-Key, send it again as it was: it is done once. If not, please check the records first.",
        ),
    },
    "drill-refused": {
        "ko": (
            "지금은 서버를 일부러 멈출 수 없어요",
            "서버가 정상으로 돌아온 뒤에 다시 해 주세요. 정책 파일에서 훈련을 꺼 두었는지도 확인해 주세요.",
        ),
        "en": (
            "The server cannot be broken on purpose now",
            "Please try again once it runs as usual, and check that the policy file allows drills.",
        ),
    },
    "guard-away": {
        "ko": ("감시자가 대답하지 않아요", "시작됐는지 아직 알 수 없어요. 잠시 뒤에 다시 해 주세요."),
        "en": (
            "The guard does not answer",
            "Whether it has begun is not known. Please try again in a moment.",
        ),
    },
    "key-reused": {
        "ko": (
            "같은 번호를 다른 요청에 썼어요",
            "이 Idempotency-Key로 이미 다른 요청을 접수했어요. 이 요청은 처리하지 않았어요. 새 번호로 다시 보내 주세요.",
        ),
        "en": (
            "This key belongs to another request",
            "Another request was received under this Idempotency-Key. This one was not done. Please send it again under a new key.",
        ),
    },
    "not-keepable": {
        "ko": (
            "이 요청은 맡아 둘 수 없어요",
            "화면의 양식을 그대로 보낸 요청만 맡아요. 처리하지 않았으니 화면을 다시 열고 보내 주세요.",
        ),
        "en": (
            "This request cannot be kept",
            "Only what a form of these pages sends is kept. It was not done: please open the page again and send it.",
        ),
    },
    "not-kept": {
        "ko": (
            "이 요청을 맡아 두지 못했어요",
            "지금은 저장할 수 없어요. 이 요청은 처리하지 않았어요. 뒤로 가서 잠시 뒤에 다시 눌러 주세요.",
        ),
        "en": (
            "This request could not be kept",
            "It cannot be stored now and was not done. Please go back and try again in a moment.",
        ),
    },
    "promise-unknown": {
        "ko": (
            "접수됐는지 아직 알 수 없어요",
            "디스크가 저장 여부를 알려 주지 않았어요. 같은 Idempotency-Key로 그대로 다시 보내면 한 번만 처리돼요.",
        ),
        "en": (
            "It is not known whether this was received",
            "The disk did not say whether it was stored. Send it again as it was, under the same Idempotency-Key: it is done once.",
        ),
    },
    "receipt-cancelled": {
        "ko": ("취소한 요청이에요", "이 요청은 처리하지 않았어요. 다시 하려면 새로 작성해서 보내 주세요."),
        "en": (
            "This request was cancelled",
            "It was not done. To do it after all, please fill it in and send it anew.",
        ),
    },
    "receipt-not-open": {
        "ko": (
            "지금은 이렇게 할 수 없어요",
            "요청의 상태가 그사이 바뀌었어요. 화면을 다시 열어 확인해 주세요.",
        ),
        "en": (
            "This cannot be done now",
            "What became of the request has changed meanwhile. Please open its page again.",
        ),
    },
    "receipts-away": {
        "ko": (
            "접수한 요청을 지금은 읽을 수 없어요",
            "접수 기록이 있는 파일은 건드리지 않았어요. 잠시 뒤에 다시 열어 주세요.",
        ),
        "en": (
            "Receipts cannot be read now",
            "Their file on the disk was left as it is. Please try again in a moment.",
        ),
    },
    "set-aside": {
        "ko": (
            "이 요청은 따로 보관했어요",
            "처리 중에 서버가 멈춘 요청이라 더는 시도하지 않아요. 이 요청은 처리하지 않았어요. 서버 관리자에게 번호를 알려 주세요.",
        ),
        "en": (
            "This request was set aside",
            "The server stopped while handling it, so it is not tried any more. It was not done. Please tell the administrator its number.",
        ),
    },
    "source-stopped": {
        "ko": (
            "이 브라우저의 입력을 잠시 멈췄어요",
            "여기에서 보낸 요청 때문에 서버가 여러 번 멈췄어요. 보기는 할 수 있고, 이 요청은 처리하지 않았어요.",
        ),
        "en": (
            "Changes from here are paused",
            "Requests sent from here stopped the server several times. You can still look at everything; this request was not done.",
        ),
    },
    "admin-local": {
        "ko": (
            "관리 화면은 서버 컴퓨터에서만 열려요",
            "서버가 켜져 있는 컴퓨터의 브라우저에서 localhost 주소로 열어 주세요.",
        ),
        "en": (
            "The dashboard opens on the server itself only",
            "Please open it in a browser on the computer that runs this server, at a localhost address.",
        ),
    },
    "admin-away": {
        "ko": ("관리 화면을 켜고 있어요", "아직 준비되지 않았어요. 잠시 뒤에 다시 열어 주세요."),
        "en": (
            "The dashboard is being started",
            "It is not ready yet. Please open it again in a moment.",
        ),
    },
    "admin-broken": {
        "ko": (
            "관리 화면의 응답이 끊겼어요",
            "요청한 일이 시작됐는지 알 수 없어요. 화면을 다시 열어 확인해 주세요.",
        ),
        "en": (
            "The dashboard's answer broke off",
            "Whether what was asked for has begun is not known. Please open the page again to see.",
        ),
    },
    "sign-in-needed": {
        "ko": (
            "로그인해 주세요",
            "이 가계부는 비밀번호로 지키고 있어요. 로그인한 뒤에 다시 시도해 주세요. 이 요청은 처리되지 않았어요.",
        ),
        "en": (
            "Please sign in",
            "This ledger is kept behind a password. Sign in and try again. This request was not done.",
        ),
    },
    "token-wrong": {
        "ko": (
            "이 토큰으로는 들어올 수 없어요",
            "토큰이 틀렸거나 지워졌어요. 서버 관리자가 새로 만들 수 있어요: hardcore token add 이름",
        ),
        "en": (
            "This token opens nothing",
            "It is wrong, or was removed. Whoever runs the server can make a new one: hardcore token add NAME",
        ),
    },
    "not-allowed": {
        "ko": (
            "이 작업은 허락되지 않았어요",
            "서버를 돌보는 사람만 할 수 있는 일이거나, 보기만 하는 토큰이에요. 이 요청은 처리되지 않았어요.",
        ),
        "en": (
            "You may not do this",
            "It is for whoever looks after the server, or this token may only look. This request was not done.",
        ),
    },
    "try-later": {
        "ko": (
            "잠시 뒤에 다시 시도해 주세요",
            "비밀번호가 여러 번 틀렸어요. 조금 기다렸다가 다시 입력해 주세요.",
        ),
        "en": (
            "Please try again in a moment",
            "The password was wrong several times. Wait a little and try again.",
        ),
    },
    "around-the-proxy": {
        "ko": (
            "이 길로는 들어올 수 없어요",
            "이 서버는 앞에 둔 프록시를 거쳐야 열려요. 서버 관리자에게 주소를 물어봐 주세요.",
        ),
        "en": (
            "Not served this way",
            "This server is opened through the proxy in front of it. Please ask whoever runs it for the address.",
        ),
    },
    "no-password-set": {
        "ko": (
            "아직 비밀번호가 없어요",
            "다른 기기에서 열려면 서버에서 먼저 비밀번호를 정해 주세요: hardcore passwd",
        ),
        "en": (
            "No password is set",
            "To be opened from other devices, the server needs one first: hardcore passwd",
        ),
    },
    "access-unreadable": {
        "ko": (
            "지금은 로그인할 수 없어요",
            "들어올 수 있는 사람의 목록을 읽지 못했어요. 서버에서 비밀번호를 다시 정해 주세요: hardcore passwd",
        ),
        "en": (
            "Nobody can sign in now",
            "The list of who may come in cannot be read. On the server, set the password again: hardcore passwd",
        ),
    },
}
