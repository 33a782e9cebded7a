"""What `hardcore service` says, in Korean and English: plain data and one lookup."""

from typing import Final

LANGUAGES: Final = ("ko", "en")

#: key -> (ko, en)
SERVICE: Final[dict[str, tuple[str, str]]] = {
    "writes": ("이 파일을 써요: {path}", "This file is written: {path}"),
    "runs": ("이 명령을 실행해요: {command}", "This command is run: {command}"),
    "dry": (
        "아무것도 바꾸지 않았어요. `--dry-run` 없이 실행하면 위와 같이 해요.",
        "Nothing was changed. Without `--dry-run` the above is done.",
    ),
    "installed": (
        "이제 부팅할 때 켜져요. 주소: {url}. 상태는 `hardcore service status`로 볼 수 있어요.",
        "It starts at boot from now on, at {url}. `hardcore service status` says how it is.",
    ),
    "linger": (
        "로그아웃해도 계속 켜 두려면 `loginctl enable-linger`를 한 번 실행하세요.",
        "Run `loginctl enable-linger` once to keep it on after you log out.",
    ),
    "down": (
        "꺼 두라고 한 장부예요. `hardcore service start`로 다시 켤 수 있어요.",
        "It was told to stay off. `hardcore service start` starts it again.",
    ),
    "started": ("켰어요.", "Started."),
    "not_started": (
        "켜라고 했지만 켜지지 않았어요 ({unit}: {active}). `journalctl -u {unit}`에서 이유를 볼 수 있어요.",
        "It was told to start and does not run ({unit}: {active}). `journalctl -u {unit}` says why.",
    ),
    "uninstalled": (
        "껐어요. 부팅할 때 더는 켜지지 않아요. 장부는 그대로 있어요: {data}",
        "Stopped; it does not start at boot any more. The ledger stays where it is: {data}",
    ),
    "not_installed": (
        "설치된 서비스가 없어요 ({path}). `hardcore service install`로 설치할 수 있어요.",
        "No service is installed ({path}). `hardcore service install` does it.",
    ),
    "no_systemd": (
        "이 컴퓨터는 systemd로 켜지지 않았어요. 다른 방법으로 `{command}`를 부팅할 때 실행하세요.",
        "This machine was not started by systemd. Have `{command}` run at boot in another way.",
    ),
    "not_root": (
        "컴퓨터 전체의 서비스는 root만 설치해요. sudo로 실행하거나 `--user`를 붙이세요.",
        "Only root installs a service of the whole machine. Use sudo, or `--user`.",
    ),
    "no_owner": (
        "{data} 폴더의 주인을 알 수 없거나 root예요. `--as 사용자`로 누구로 실행할지 알려 주세요.",
        "{data} has no owner, or root has it. Say who it is to run as: `--as USER`.",
    ),
    "foreign": (
        "{path} 파일은 이 명령이 쓴 파일이 아니에요. 옮긴 뒤에 다시 하거나 `--name`으로 다른 이름을 쓰세요.",
        "{path} was not written by this command. Move it away first, or use another `--name`.",
    ),
    "running": (
        "이 장부가 지금 켜져 있어요. `{command} down`을 먼저 하세요.",
        "This ledger runs now. Do `{command} down` first.",
    ),
    "odd_path": (
        "폴더 이름에 줄바꿈이나 따옴표가 있어 서비스로 켤 수 없어요: {path}",
        "The folder's name has a line break or a quote in it and can't be served so: {path}",
    ),
    "not_written": ("{path} 파일을 쓸 수 없어요 ({why}).", "{path} can't be written ({why})."),
    "command_failed": (
        "명령이 되지 않았어요: {command} ({why}). `journalctl -u {unit}`에서 이유를 볼 수 있어요.",
        "A command failed: {command} ({why}). `journalctl -u {unit}` says why.",
    ),
    "state": (
        "{unit}: {active} ({sub}), 프로세스 {pid}, 다시 켠 횟수 {restarts}",
        "{unit}: {active} ({sub}), process {pid}, started again {restarts} times",
    ),
}


def service_words(key: str, lang: str, **values: object) -> str:
    """Return one text with its values in it."""
    return SERVICE[key][LANGUAGES.index(lang)].format(**values)
