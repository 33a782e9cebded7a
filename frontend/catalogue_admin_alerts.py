"""What the dashboard says of alerts, Korean and English: who would be told, what came of it, a try, a silence."""

from collections.abc import Mapping
from typing import Final

Text = Mapping[str, str]


def _text(ko: str, en: str) -> Text:
    return {"ko": ko, "en": en}


ALERT_TEXTS: Final[Mapping[str, Text]] = {
    "nav_alerts": _text("알림", "Alerts"),
    "alerts_title": _text("알림", "Alerts"),
    "alerts_none": _text(
        "알림 채널이 없어요. 일이 생겨도 알려 줄 수 없어요.", "No channel: you would not be told."
    ),
    "alerts_away": _text(
        "감시자가 대답하지 않아요. 마지막으로 보낸 기록만 보여요.",
        "The guard does not answer: only what was sent last is shown.",
    ),
    "alerts_how": _text(
        "채널은 정책 파일의 alerts에 적어요. 화면에서 고치는 일은 암호를 둘 수 있을 때부터 할 수 있어요.",
        "Channels are named under alerts in the policy file. Editing them here comes with sign-in.",
    ),
    "alerts_channels": _text("채널", "Channels"),
    "alerts_last": _text("마지막 전달", "Last delivery"),
    "alerts_arrived": _text("도착함", "arrived"),
    "alerts_failed": _text("도착하지 않음: {why}", "did not arrive: {why}"),
    "alerts_never": _text("아직 보낸 적이 없음", "nothing was sent yet"),
    "alerts_counts": _text("보냄 {sent}, 못 보냄 {failed}", "{sent} sent, {failed} failed"),
    "alerts_floor": _text("같은 소식", "The same again"),
    "alerts_floor_n": _text("{n}초 안에 한 번까지", "once in {n} s at most"),
    "alerts_quiet": _text("조용한 시간", "Quiet hours"),
    "alerts_lang": _text("언어", "Language"),
    "alerts_test": _text("지금 시험하기", "Test now"),
    "alerts_mute": _text("잠시 끄기", "Mute for a while"),
    "alerts_mute_for": _text("얼마 동안", "For how long"),
    "mute_3600": _text("1시간", "1 hour"),
    "mute_28800": _text("8시간", "8 hours"),
    "mute_86400": _text("하루", "1 day"),
    "alerts_unmute": _text("다시 켜기", "Unmute"),
    "alerts_muted": _text("알림을 꺼 두었어요. 다시 켜지는 때: {at}", "Alerts are muted until {at}."),
    "alerts_lately": _text("최근 알림", "Lately"),
    "alerts_lately_none": _text("보낸 알림이 아직 없어요.", "No alert is on record yet."),
    "alerts_lately_nobody": _text(
        "기록된 사건: {n}건. 채널이 없어서 알림을 보내지 않았어요.",
        "Incidents on record: {n}. Nobody was told of any, as there was no channel.",
    ),
    "alerts_what": _text("알림", "Alert"),
    "alerts_became": _text("결과", "What came of it"),
    "alerts_delivered": _text("보냄", "sent"),
    "alerts_not_sent": _text("보내지 않음: {why}", "not sent: {why}"),
    "alerts_undelivered": _text("도착하지 않음", "did not arrive"),
    "alerts_under_way": _text("보내는 중", "on its way"),
    "alerts_preview": _text("무엇을 보내나요", "What is sent"),
    "said_alerts_tested": _text("모든 채널에 도착했어요.", "It has arrived on every channel."),
    "said_alerts_trying": _text(
        "보내고 있어요. 결과는 잠시 뒤 여기에 보여요.",
        "It is being sent; the result appears here in a moment.",
    ),
    "refused_alerts_test": _text(
        "도착하지 않은 채널이 있어요. 아래에서 이유를 볼 수 있어요.",
        "It did not arrive on every channel; see below why.",
    ),
    "said_alerts_muted": _text("알림을 꺼 두었어요.", "Alerts are muted."),
    "said_alerts_unmuted": _text("알림을 다시 보내요.", "Alerts are sent again."),
}
