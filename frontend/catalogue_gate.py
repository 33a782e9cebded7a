"""What is said where somebody signs in, in Korean and English: the gateway's own pages for it.

Plain data. A page says only what its reader needs: not whether a name exists, and not how a password is kept.
"""

from typing import Final

#: code -> (ko, en). A kind of page has its heading and its line; `do.*` are the buttons.
GATE: Final[dict[str, tuple[str, str]]] = {
    "in": ("로그인", "Sign in"),
    "in.line": ("이 가계부는 비밀번호로 지키고 있어요.", "This ledger is kept behind a password."),
    "unsent": ("다시 로그인해 주세요", "Please sign in again"),
    "unsent.line": (
        "방금 보낸 내용은 처리하지 않았어요. 로그인하면 쓰던 화면으로 돌아가요.",
        "What you just sent was not done. After signing in you are back where you were.",
    ),
    "out": ("로그아웃했어요", "You are signed out"),
    "out.line": ("쓰던 내용은 이 탭에서 지웠어요.", "What was typed in this tab and not sent is deleted."),
    "wrong": ("로그인", "Sign in"),
    "wrong.line": (
        "이름이나 비밀번호가 맞지 않아요. 다시 입력해 주세요.",
        "The name or the password is not right. Please try again.",
    ),
    "wait": ("잠시 기다려 주세요", "Please wait a moment"),
    "wait.line": (
        "지금은 로그인 시도가 너무 많아요. 몇 초 뒤에 다시 입력해 주세요.",
        "There were too many tries just now. Try again in a few seconds.",
    ),
    "again": ("비밀번호를 한 번 더 입력해 주세요", "Please type your password again"),
    "again.line": (
        "되돌릴 수 없거나 남이 보면 안 되는 것이라서 본인인지 확인해요. 그다음 화면에서 한 번 더 눌러 주세요.",
        "What comes next can't be taken back, or shows what is private. Afterwards, press the button once more.",
    ),
    "again_wrong": ("비밀번호를 한 번 더 입력해 주세요", "Please type your password again"),
    "again_wrong.line": ("비밀번호가 맞지 않아요.", "The password is not right."),
    "invited": ("비밀번호 정하기", "Choose a password"),
    "invited.line": (
        "8자 이상으로 정해 주세요. 길수록 안전해요.",
        "At least 8 characters; longer is safer.",
    ),
    "short": ("비밀번호 정하기", "Choose a password"),
    "short.line": (
        "비밀번호는 8자 이상, 1,024바이트 이하여야 해요.",
        "A password has at least 8 characters and at most 1,024 bytes.",
    ),
    "differ": ("비밀번호 정하기", "Choose a password"),
    "differ.line": ("두 비밀번호가 서로 달라요.", "The two passwords are not the same."),
    "not_kept": ("비밀번호 정하기", "Choose a password"),
    "not_kept.line": (
        "서버의 디스크에 쓰지 못해서 저장하지 못했어요. 서버 관리자에게 알려 주세요.",
        "It could not be kept: the server's disk refused it. Please tell whoever runs the server.",
    ),
    "gone": ("이 링크는 이제 쓸 수 없어요", "This link no longer works"),
    "gone.line": (
        "이미 썼거나 시간이 지났어요. 서버 관리자에게 새 링크를 부탁해 주세요.",
        "It was used, or its time is over. Please ask whoever runs the server for a new one.",
    ),
    "name": ("이름", "Name"),
    "password": ("비밀번호", "Password"),
    "new": ("새 비밀번호", "New password"),
    "repeat": ("한 번 더", "Once more"),
    "do.in": ("로그인", "Sign in"),
    "do.again": ("확인", "Continue"),
    "do.invited": ("정하기", "Set password"),
    "do.back": ("돌아가기", "Back"),
    "other": ("English", "한국어"),
    "app": ("가계부", "Household ledger"),
}
