"""What reports say of a gateway or a guard that was lost, Korean and English: findings of `catalogue_findings`, as data."""

from collections.abc import Mapping


def _text(ko: str, en: str) -> Mapping[str, str]:
    return {"ko": ko, "en": en}


LOST: Mapping[str, Mapping[str, str]] = {
    "gateway_killed": _text(
        "다른 누군가가 관문을 강제 종료했어요(SIGKILL). 장부 서버는 그대로 있었어요.",
        "Somebody else killed the gateway (SIGKILL). The ledger's core was not touched.",
    ),
    "gateway_out_of_memory": _text(
        "메모리가 모자라 운영체제가 관문을 종료한 것으로 보여요.",
        "The system seems to have ended the gateway because memory had run out.",
    ),
    "gateway_crashed": _text("관문이 신호로 종료됐어요: {signal}", "The gateway ended by a signal: {signal}"),
    "gateway_exited": _text(
        "관문이 스스로 종료됐어요. 종료 코드: {code}", "The gateway left by itself with exit code {code}."
    ),
    "gateway_frozen": _text(
        "관문이 밖에서 정지된 상태였어요. 장부 서버는 그대로 있었어요.",
        "The gateway had been stopped from outside. The ledger's core was not touched.",
    ),
    "gateway_hung": _text(
        "관문이 더 움직이지 않았어요. 어디에서 멈췄는지는 기록되지 않았어요.",
        "The gateway stood still; where is not on record.",
    ),
    "gateway_hung_in": _text(
        "관문이 여기서 멈춰 있었어요: {function} ({place})", "The gateway hung here: {function} ({place})"
    ),
    "gateway_poison": _text(
        "이 주소의 요청을 읽다가 관문이 두 번 종료됐어요. 10분 동안 받지 않아요: {path}",
        "Two gateways died while they read a request for this path; it is refused for ten minutes: {path}",
    ),
    "gateway_untold": _text("관문이 왜 종료됐는지 알 수 없어요.", "Why the gateway ended can't be told."),
    "sentinel_gone": _text(
        "감시자가 종료돼서 새 감시자가 이어받았어요. 왜 종료됐는지, 얼마나 비어 있었는지는 알 수 없어요.",
        "The guard had died, and another took over. Why, and for how long nobody watched, can't be told.",
    ),
    "sentinel_gone_for": _text(
        "감시자가 종료돼서 새 감시자가 이어받았어요. 아무도 지켜보지 않은 시간: {seconds}초",
        "The guard had died, and another took over. Nobody watched for {seconds} s",
    ),
    "sentinel_frozen": _text(
        "감시자가 멈춰 있어서 끝내고, 새 감시자가 이어받았어요.",
        "The guard stood still; it was ended, and another took over.",
    ),
    "sentinel_frozen_for": _text(
        "감시자가 멈춰 있어서 끝내고, 새 감시자가 이어받았어요. 아무도 지켜보지 않은 시간: {seconds}초",
        "The guard stood still; it was ended, and another took over. Nobody watched for {seconds} s",
    ),
}
