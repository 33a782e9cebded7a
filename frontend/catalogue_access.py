"""What the owner's words about passwords, tokens and the open door say, in Korean and English.

Plain data and one lookup, as in `catalogue.py`. No particle stands right after a value.
"""

from collections.abc import Mapping
from typing import Final

LANGUAGES: Final = ("ko", "en")

#: key -> (ko, en)
WORDS: Final[Mapping[str, tuple[str, str]]] = {
    "type_it": ("새 비밀번호", "New password"),
    "type_again": ("한 번 더", "Once more"),
    "differ": (
        "두 비밀번호가 서로 달라요. 아무것도 바꾸지 않았어요.",
        "The two are not the same; nothing was changed.",
    ),
    "short": (
        "비밀번호는 UTF-8 글자로 8자 이상, 1,024바이트 이하여야 해요. 아무것도 바꾸지 않았어요.",
        "A password has at least 8 characters and at most 1,024 bytes of UTF-8; nothing was changed.",
    ),
    "name_bad": (
        "이름에는 소문자, 숫자, 점, 밑줄, 붙임표만 쓸 수 있어요(32자까지).",
        "A name is made of lower-case letters, digits, dots, dashes and underscores, up to 32.",
    ),
    "set": (
        "비밀번호를 정했어요: {name}. 지금부터 로그인해야 열려요. 이전 비밀번호로 들어온 곳은 모두 로그아웃됐어요.",
        "The password is set: {name}. From now on one has to sign in; whoever came in with an older one is signed out.",
    ),
    "owner_first": (
        "먼저 서버를 돌보는 사람의 비밀번호를 정해 주세요: {command} passwd",
        "Set the password of whoever looks after the server first: {command} passwd",
    ),
    "removed": ("지웠어요: {name}", "Removed: {name}"),
    "unknown": ("그런 이름은 없어요: {name}", "There is nobody of that name: {name}"),
    "others_first": (
        "다른 사람의 비밀번호나 초대 링크, 토큰이 남아 있어요. 그것들을 먼저 지워 주세요: {names}",
        "Others still have a password, a link or a token; remove those first: {names}",
    ),
    "door_open": (
        "이 가계부는 다른 기기에도 열려 있어요. 비밀번호를 지우려면 `hardcore down` 뒤에 127.0.0.1로 다시 시작하세요.",
        "This ledger is open to other devices. To go without a password, `hardcore down` and start it on 127.0.0.1.",
    ),
    "link": (
        "이 링크를 열고 비밀번호를 정하면 돼요. 한 번만, {hours}시간 안에 쓸 수 있어요.",
        "Open this link and choose the password. It works once, within {hours} hours.",
    ),
    "nobody": (
        "비밀번호가 없어요. 이 컴퓨터 안에서만 열려요.",
        "No password is set; only this machine is served.",
    ),
    "no_tokens": ("토큰이 없어요.", "There are no tokens."),
    "person": ("{name} · {scope}", "{name} · {scope}"),
    "invited": (
        "{name} · 아직 비밀번호를 정하지 않았어요",
        "{name} · invited, has not chosen a password yet",
    ),
    "token_made": (
        "토큰을 만들었어요: {name}. 다시 볼 수 없으니 지금 적어 두세요.",
        "The token is made: {name}. It is shown only now: keep it.",
    ),
    "token_use": (
        "쓰는 법: curl -H 'Authorization: Bearer …' {url}/api/ledger/accounts",
        "To use it: curl -H 'Authorization: Bearer …' {url}/api/ledger/accounts",
    ),
    "token_there": (
        "그런 이름의 토큰이 이미 있어요: {name}",
        "There is a token of that name already: {name}",
    ),
    "token": ("{name} · {scope} · {made_at}", "{name} · {scope} · {made_at}"),
    "many": (
        "더는 만들 수 없어요. 쓰지 않는 것을 먼저 지워 주세요.",
        "There are too many; remove one that is not used first.",
    ),
    "unreadable": (
        "{path} 파일을 읽지 못했어요({why}). 다른 곳으로 옮긴 뒤 비밀번호를 다시 정해 주세요.",
        "{path} can't be read ({why}). Move it away and set the passwords again.",
    ),
    "scope_admin": ("서버를 돌보는 사람", "looks after the server"),
    "scope_write": ("가계부 쓰기", "may change the ledger"),
    "scope_read": ("보기만", "may only look"),
    "open_password": (
        "--host {host}: 다른 기기에 열려면 먼저 비밀번호가 있어야 해요: {command} passwd",
        "--host {host}: to serve other devices there must be a password first: {command} passwd",
    ),
    "proxy_password": (
        "--trusted-proxy: 프록시 뒤에서 열려면 먼저 비밀번호가 있어야 해요: {command} passwd",
        "--trusted-proxy: behind a proxy there must be a password first: {command} passwd",
    ),
    "open_plain": (
        "--host {host}: 비밀번호가 암호화되지 않은 채 오가면 안 돼요. --tls-cert와 --tls-key를 주거나, 앞에 둔 프록시를 --trusted-proxy로 알려 주세요. 집 안의 망을 믿는다면 --insecure-lan을 쓸 수 있어요.",
        "--host {host}: a password must not travel in the open. Give --tls-cert and --tls-key, or name the proxy in front with --trusted-proxy. If you trust this network as it is, --insecure-lan says so.",
    ),
    "insecure": (
        "--insecure-lan: 같은 망에 있는 누구나 오가는 내용을 엿볼 수 있어요. 비밀번호도요.",
        "--insecure-lan: anybody on this network can read what is sent, passwords too.",
    ),
    "host_bad": (
        "--host {host}: 주소로 적어 주세요. 예: 0.0.0.0 (모든 기기), 127.0.0.1 (이 컴퓨터만)",
        "--host {host}: give an address, such as 0.0.0.0 (every device) or 127.0.0.1 (this machine alone).",
    ),
    "tls_pair": (
        "--tls-cert와 --tls-key는 함께 주세요.",
        "--tls-cert and --tls-key belong together: give both.",
    ),
    "tls_bad": ("인증서나 열쇠를 쓸 수 없어요: {why}", "The certificate or its key can't be used: {why}"),
    "proxy_bad": (
        "--trusted-proxy {given}: 10.0.0.5 또는 10.0.0.0/8처럼 적어 주세요.",
        "--trusted-proxy {given}: give an address or a network, such as 10.0.0.5 or 10.0.0.0/8.",
    ),
    "door_later": (
        "이 가계부는 이미 돌고 있어요. 여는 방법을 바꾸려면 `hardcore down` 뒤에 다시 시작하세요.",
        "This ledger is already running. To open it in another way, `hardcore down` and start it again.",
    ),
}


def access_text(key: str, lang: str, **values: object) -> str:
    """Return a text in a language, its values filled in. KeyError for a key that is not here: our own bug."""
    return WORDS[key][LANGUAGES.index(lang)].format(**values)
