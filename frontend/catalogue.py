"""What the command line says: one text for each thing, in Korean and English.

Plain data and one lookup. A sentence that tells of a failure says the next step. In Korean no particle stands
right after a value.
"""

from collections.abc import Mapping
from typing import Any, Final

#: key -> (ko, en)
CLI: Final[dict[str, tuple[str, str]]] = {
    "serving": (
        "가계부: {url}\n끄려면 Ctrl-C를 누르세요. 상태는 `{command} status`로 볼 수 있어요.",
        "Ledger: {url}\nCtrl-C stops it. `{command} status` shows how it is.",
    ),
    "dashboard": ("대시보드: {url}/admin", "Dashboard: {url}/admin"),
    "demo": (
        "데모: {url}/__hc/demo\n이 화면의 단추는 서버를 정말로 멈춰요. 데이터 폴더: {data}",
        "Demo: {url}/__hc/demo\nIts buttons really break the server. Data folder: {data}",
    ),
    "demo_later": (
        "이 가계부는 이미 돌고 있어요. `hardcore down`으로 끈 뒤에 --demo로 다시 시작하세요.",
        "This ledger is already running. Stop it with `hardcore down`, then start it with --demo.",
    ),
    "no_spare_later": (
        "이 가계부는 이미 돌고 있어요. `hardcore down`으로 끈 뒤에 --no-spare로 다시 시작하세요.",
        "This ledger is already running. Stop it with `hardcore down`, then start it with --no-spare.",
    ),
    "attached": (
        "이미 돌고 있던 감시자에 다시 붙었어요: {url}",
        "Attached to the sentinel that was still running: {url}",
    ),
    "already_running": (
        "이 데이터 폴더는 이미 쓰이고 있어요 ({url}). `hardcore status`로 보거나 `hardcore down`으로 끄세요.",
        "This data folder is already in use ({url}). See `hardcore status`, or stop it with `hardcore down`.",
    ),
    "port_taken": (
        "포트 {port}번을 다른 프로그램이 쓰고 있어요. --port로 다른 번호를 고르세요 (예: --port {next}).",
        "Port {port} is in use by another program. Choose another with --port, for example --port {next}.",
    ),
    "port_ours": (
        "포트 {port}번은 이 장부를 지키던 프로그램이 남긴 프로세스가 쓰고 있어요 ({pids}). `{command} down`으로 끈 뒤에 다시 켜세요.",
        "Port {port} is held by what this ledger's last guard left ({pids}). `{command} down` ends it; then start again.",
    ),
    "cannot_listen": (
        "{host}:{port} 주소를 열 수 없어요 ({why}). --host와 --port를 확인하세요.",
        "Can't listen on {host}:{port} ({why}). Check --host and --port.",
    ),
    "handed_unfit": (
        "서비스 관리자가 넘겨준 소켓을 쓸 수 없어요. 소켓 유닛에 TCP 주소를 하나만 적으세요 (예: ListenStream=127.0.0.1:3000).",
        "The service manager's socket can't be used. Give its unit one TCP address (ListenStream=127.0.0.1:3000).",
    ),
    "policy_bad": ("정책 파일에 고칠 곳이 있어요: {path}", "The policy file needs mending: {path}"),
    "policy_kept": (
        "정책 파일에 잘못이 있어서 지난번의 올바른 정책을 계속 써요. `hardcore policy check {path}`로 확인하세요.",
        "The policy file is faulty, so the last good one stays in force. See `hardcore policy check {path}`.",
    ),
    "policy_later": (
        "돌고 있는 감시자가 몇 초 안에 이 정책을 써요: {path}. 지금 쓰는 정책은 `hardcore policy show`로 볼 수 있어요.",
        "The running sentinel takes this policy within seconds: {path}. `hardcore policy show` tells what is in force.",
    ),
    "mode_later": (
        "이 가계부는 이미 돌고 있어요. 정책의 mode를 바꾸거나, `hardcore down` 뒤에 --mode로 다시 시작하세요.",
        "This ledger is already running. Change `mode` in the policy, or `hardcore down` and start it with --mode.",
    ),
    "policy_next": (
        "이대로는 쓰이지 않아요. 돌고 있는 감시자는 고친 파일을 몇 초 안에 읽어요.",
        "It is not taken as it is. A running guard reads the mended file within seconds.",
    ),
    "policy_changed": (
        "정책 파일과 달라요. 방금 바뀌었거나, 이번 실행에만 쓰는 값이 있어요 (`hardcore policy show --file`로 볼 수 있어요).",
        "The file says otherwise: it has just changed, or `up` was given a value for this run. See `hardcore policy show --file`.",
    ),
    "policy_of_next_start": (
        "감시자가 돌고 있지 않아요. 다음에 시작할 때 쓸 정책이에요.",
        "No sentinel is running: this is what the next start will use.",
    ),
    "policy_none": (
        "정책 파일이 없어서 기본값을 써요: {path}",
        "There is no policy file, so the defaults hold: {path}",
    ),
    "no_diagnosis": (
        "{name}: 이런 진단은 없어요. `hardcore policy explain`으로 목록을 볼 수 있어요.",
        "{name} is no diagnosis. `hardcore policy explain` lists them.",
    ),
    "policy_good": ("정책 파일이 올바라요: {path}", "The policy is fine: {path}"),
    "unreachable": (
        "감시자가 돌고 있지 않아요. `hardcore up`으로 시작하세요.",
        "The sentinel is not running. Start it with `hardcore up`.",
    ),
    "silent": (
        "감시자가 있지만 대답하지 않아요. 잠시 뒤 다시 해 보거나, 계속되면 `hardcore up` 창을 확인하세요.",
        "The sentinel is there but does not answer. Try again shortly; if it lasts, look at the `hardcore up` window.",
    ),
    "refused": ("안 했어요: {why}", "Not done: {why}"),
    "stopping": ("끄는 중이에요. 하던 일은 마칠게요.", "Stopping. What is under way will be finished."),
    "stopped": ("껐어요. 다시 켜기 전까지 꺼져 있어요.", "Stopped. It stays off until `hardcore up`."),
    "nothing_running": (
        "돌고 있는 것이 없어요. 꺼진 상태로 기억해 둘게요.",
        "Nothing was running. It is noted that it should stay off.",
    ),
    "down_not_stored": (
        "꺼진 상태로 기억해 둘 수 없어서 끄지 않았어요 ({why}). 데이터 폴더에 쓸 수 있게 한 뒤 다시 하세요.",
        "Not stopped: that it should stay off can't be written ({why}). Make the data folder writable and try again.",
    ),
    "data_not_written": (
        "데이터 폴더에 쓸 수 없어요: {path} ({why}). 자리를 만들거나 --data로 다른 폴더를 고르세요.",
        "The data folder can't be written: {path} ({why}). Make room, or choose another with --data DIR.",
    ),
    "nothing_there": (
        "이 폴더에는 끌 것이 없어요. --data가 맞는지 확인하세요.",
        "There is nothing to stop in this folder. Check --data.",
    ),
    "goes_on": (
        "여기까지만 볼게요. 일은 계속돼요: `hardcore status`",
        "It goes on by itself: see `hardcore status`.",
    ),
    "still_stopping": (
        "{seconds}초가 지났는데 아직 끄는 중이에요. `hardcore status`로 확인하세요.",
        "Still stopping after {seconds} seconds. See `hardcore status`.",
    ),
    "restarting": ("핵심 서버를 다시 켜는 중이에요.", "Restarting the core."),
    "switching": ("기다리던 예비 서버로 바꾸는 중이에요.", "Switching to the spare core."),
    "awaits_spare": (
        "예비 서버가 준비되면 바꿀게요. 그때까지 지금 서버가 계속 일해요.",
        "Waiting for a spare core. The one that serves goes on until then.",
    ),
    "awaits_update": (
        "새 코드로 예비 서버를 준비하는 중이에요. 그때까지 지금 서버가 계속 일해요.",
        "Waiting for a spare core with the new code. The one that serves goes on until then.",
    ),
    "switch_left": (
        "여기까지만 볼게요. 부탁은 그대로 남아서 예비 서버가 준비되면 바꿔요: `hardcore status`",
        "The wish stands: the switch is done as soon as a spare is ready. See `hardcore status`.",
    ),
    "switch_refused": (
        "바꾸지 못했어요. 지금 서버가 그대로 일하고 있고 잃은 것은 없어요.\n  까닭: {why}\n{log} 파일을 보고 고친 뒤 `hardcore restart`를 다시 하세요.",
        "Not switched. The core that served goes on, and nothing is lost.\n  Why: {why}\nLook at {log}, mend it, then `hardcore restart` again.",
    ),
    "switch_unspared": (
        "고칠 때까지는 예비 서버가 없어요. 디스크의 코드로는 새 서버를 켤 수 없으니, 지금 서버가 멈추면 돌아올 수 없어요.",
        "Until it is mended no spare waits, and if the core that serves dies, none can be started from this code.",
    ),
    "stopped_meanwhile": (
        "기다리는 동안 전체가 꺼졌어요. 다시 켜려면 `hardcore up`을 하세요.",
        "Everything was stopped meanwhile, as somebody asked. `hardcore up` starts it.",
    ),
    "switch_forgotten": (
        "감시자가 바뀌면서 이 부탁이 사라졌어요. 지금 서버가 그대로 일하고 있어요. `hardcore restart`를 다시 하세요.",
        "The guard was replaced meanwhile, and the wish is gone. The core goes on: `hardcore restart` again.",
    ),
    "restarted": (
        "새 서버로 바꿨어요. 응답을 기다리게 한 시간: {ms} ms. 사건 번호: {incident}",
        "A new core serves. Nobody was served for {ms} ms. Incident: {incident}",
    ),
    "restarted_to_read": (
        "다시 켰지만 지금은 읽기만 돼요. {next} 사건 번호: {incident}",
        "Restarted, but it only reads at present. {next} Incident: {incident}",
    ),
    "not_back": ("다시 켜지 못했어요. {next}", "It does not serve. {next}"),
    "not_back_why": ("다시 켜지 못했어요. {next}\n  까닭: {why}", "It does not serve. {next}\n  Why: {why}"),
    "starting_already": (
        "이미 새로 켜는 중이에요. 돌아오기를 기다려요.",
        "A new core is on its way already. Waiting for it.",
    ),
    "no_comeback": (
        "{seconds}초 안에 돌아오지 않았어요. `hardcore status`와 `hardcore incidents`를 보세요.",
        "It did not come back within {seconds} seconds. See `hardcore status` and `hardcore incidents`.",
    ),
    "resumed": ("다시 해 보는 중이에요.", "Trying again."),
    "resume_needless": (
        "다시 할 것이 없어요. 지금 상태: {state}",
        "There is nothing to try again: it is {state}.",
    ),
    "drill_begins": ("훈련 {fault}: {done}\n약속: {promised}", "Drill {fault}: {done}\nPromised: {promised}"),
    "drill_kept": (
        "약속대로예요. {summary}{by}\n발견까지 {detected} · 사건 번호: {incident}",
        "As promised. {summary}{by}\nNoticed {detected} · incident {incident}",
    ),
    "back_by_spare": (" 예비 서버가 이어받았어요.", " The spare took over."),
    "back_by_start": (
        " 준비된 예비 서버가 없어서 새로 켰어요.",
        " No spare was ready, so it was started anew.",
    ),
    "back_by_itself": ("", ""),
    "drill_other": (
        "약속과 달라요.\n  약속: {promised}\n  결과: {summary}\n자세히: `hardcore incidents show {incident}`",
        "Not as promised.\n  Promised: {promised}\n  Came:     {summary}\nMore: `hardcore incidents show {incident}`",
    ),
    "drill_untold": (
        "약속과 달라요. 훈련이 끝나지 않았고 사람의 확인이 필요해요. {next}",
        "Not as promised: the drill has not come to an end, and it waits for you. {next}",
    ),
    "drill_spared": (
        "약속대로예요. 새 예비 서버가 준비됐고 장부 서버는 그대로예요. 걸린 시간: {seconds}초",
        "As promised: another spare waits after {seconds} s, and the core that serves was not touched.",
    ),
    "drill_spareless": (
        "약속과 달라요. 새 예비 서버가 오지 않았어요. {why}",
        "Not as promised: no other spare came. {why}",
    ),
    "drill_calm": ("약속대로예요. 아무도 건드리지 않았어요.", "As promised: nobody touched it."),
    "drill_disturbed": (
        "약속과 달라요. 건강한 장부 서버를 건드렸어요. `hardcore incidents`를 보세요.",
        "Not as promised: a healthy server was disturbed. See `hardcore incidents`.",
    ),
    "noticed_at_once": ("바로", "at once"),
    "noticed_after": ("{ms} ms", "after {ms} ms"),
    "noticed_untold": ("기록 없음", "at a time that is not on record"),
    "replay_same": (
        "기록된 사실 {facts}건을 다시 넣었더니 똑같이 했어요 (명령 {orders}건).",
        "{facts} recorded facts were given again, and all {orders} orders were the same.",
    ),
    "replay_other": (
        "기록된 사실 {facts}건을 다시 넣었더니 다르게 했어요.",
        "{facts} recorded facts were given again, and the orders were not the same.",
    ),
    "replay_where": (
        "처음 달라진 곳: {line}번째 줄, {fact}\n  기록: {recorded}\n  지금: {given}",
        "First at line {line}, {fact}\n  recorded: {recorded}\n  given now: {given}",
    ),
    "replay_damaged": (
        "사건 {incident}: 기록을 다시 넣어 볼 수 없어요. 파일이 상했거나 다른 버전이 남긴 것이에요.\n  {file}: {why}",
        "Incident {incident} can't be replayed: its recording is damaged, or another version's.\n  {file}: {why}",
    ),
    "replay_missing": (
        "사건 {incident}: 다시 넣어 볼 기록이 없어요. 아직 끝나지 않았거나, 감시자가 기록을 쓰기 전에 멈췄어요.",
        "Incident {incident} has no recording: it is not closed yet, or its guard ended before it wrote one.",
    ),
    "verify_ok": (
        "장부가 맞아요. 기록 {events}건, 모든 통화의 합이 0이에요.",
        "The ledger is whole: {events} events, and every currency sums to zero.",
    ),
    "verify_bad": (
        "장부가 맞지 않아요. 처음 어긋난 곳: {seq}번 기록. {reason} 입력을 멈추고 백업을 확인하세요.",
        "The ledger does not hold: the first fault is at event {seq}. {reason} Stop writing and look at your backup.",
    ),
    "verify_failed": ("장부를 확인하지 못했어요: {why}", "The ledger could not be checked: {why}"),
    "exported": ("저장했어요: {path}", "Written: {path}"),
}

LANGUAGES: Final = ("ko", "en")

#: Why the guard says no, by the code of its answer -> (ko, en). What has no text here is said in its own words.
REFUSALS: Final[dict[str, tuple[str, str]]] = {
    "drills-off": (
        "정책이 훈련을 막아 두었어요 (`drills`가 false).",
        "The policy forbids drills (`drills` is false).",
    ),
    "not-running": (
        "훈련은 장부 서버가 돌고 있을 때만 할 수 있어요. `hardcore status`를 보세요.",
        "A drill needs a ledger that runs. See `hardcore status`.",
    ),
    "not-in-question": (
        "지금은 장부에 문제가 있다고 보지 않아서, 마지막으로 확인된 것을 그대로 기준으로 삼아요.",
        "No ledger is in question: what was last seen of it stays what it has to match.",
    ),
    "drill-under-way": (
        "다른 훈련을 하는 중이에요. 끝난 뒤에 다시 하세요.",
        "A drill is under way. Wait until it is over.",
    ),
    "reads-only": (
        "지금은 읽기만 되는 상태라서 훈련을 하지 않아요. `hardcore status`에 까닭이 있어요.",
        "The ledger only reads at present, so there is no drill. `hardcore status` says why.",
    ),
    "incident-open": (
        "아직 끝나지 않은 사건이 있어요 ({incident}). 끝난 뒤에 다시 하세요.",
        "An incident is still open ({incident}). Wait until it is closed.",
    ),
    "no-spare": (
        "지금은 기다리는 예비 서버가 없어요. `hardcore status`에 까닭이 있어요.",
        "No spare core waits at present. `hardcore status` says why.",
    ),
    "others": (
        "다른 연결이 열려 있어요 ({count}개). 그래도 하려면 --yes를 붙이세요.",
        "Others are connected ({count}). Add --yes to break the core under them.",
    ),
    "no-image": (
        "지금 쓰는 정책의 `memory_image`가 never예요. on_request로 고치면 몇 초 안에 적용돼요.",
        "`memory_image` is never in the policy in force. Set it to on_request; that is taken within seconds.",
    ),
    "unkillable": (
        "앞의 서버가 아직 끝나지 않았어요. 둘이 함께 돌면 돈을 잃을 수 있어서 기다려요.",
        "The old core does not die; a second one beside it could lose money.",
    ),
    "stopping": (
        "끄는 중이에요. `hardcore up`으로 켜면 전에 바라던 대로 켜져요.",
        "It is being stopped; `hardcore up` starts it as it was wanted before.",
    ),
    "safe-by-policy": (
        "사람이 켠 안전 모드가 아니에요. 이유: {safe}. 풀리면 저절로 끝나고, `hardcore resume`으로 다시 해 볼 수 있어요.",
        "Nobody asked for reading only: {safe} is why. It ends by itself, or `hardcore resume` tries again.",
    ),
    "wish-not-stored": (
        "기억해 둘 수 없어서 하지 않았어요 ({why}). 데이터 폴더에 쓸 수 있게 한 뒤 다시 하세요.",
        "Nothing was changed: what is wanted can't be written ({why}). Make the data folder writable and try again.",
    ),
    "no-component": (
        "지금은 일하는 핵심 서버가 없어서 다시 시작할 부분도 없어요.",
        "No core serves now, so there is no part of it to start anew.",
    ),
    "component-unknown": (
        "이런 부분은 없어요: {component}. 있는 것: {names}",
        "There is no part called {component}. There are: {names}",
    ),
    "component-not-restarted": (
        "다시 시작하지 못했어요: {component} ({why})",
        "{component} was not started anew: {why}",
    ),
    "not-read": (
        "정책 파일을 지금 읽을 수 없어요. 디스크가 대답하지 않아요.",
        "The policy file can't be read now: its disk does not answer.",
    ),
}


def text(key: str, lang: str, **values: object) -> str:
    """Return a text in a language, its values filled in. A key that is missing is our own bug."""
    return CLI[key][LANGUAGES.index(lang)].format_map(values)


#: What the status page calls things: state -> (ko, en)
STATES: Final[dict[str, tuple[str, str]]] = {
    "STARTING": ("시작하는 중", "starting"),
    "OPERATIONAL": ("정상", "working"),
    "DEGRADED": ("느려지거나 걱정되는 점이 있음", "working, with a worry"),
    "RECOVERY": ("복구하는 중", "recovering"),
    "SAFE_MODE": ("읽기 전용", "read-only"),
    "MANUAL_INTERVENTION": ("사람의 확인이 필요함", "waiting for you"),
    "SHUTDOWN": ("끄는 중이거나 꺼져 있음", "stopping or stopped"),
    "UNKNOWN": ("감시자가 없음", "no sentinel answers"),
}

#: Labels of the status page.
LABELS: Final[dict[str, tuple[str, str]]] = {
    "state": ("상태", "State"),
    "address": ("주소", "Address"),
    "core": ("핵심 서버", "Core"),
    "spare": ("예비 서버", "Spare"),
    "behind": ("물러난 서버", "Old core"),
    "switch": ("바꾸기", "Switch"),
    "switch_waits": ("예비 서버가 준비되면 바꿔요", "waits for a spare"),
    "spare_ready": ("준비됨", "ready"),
    "spare_starting": ("준비하는 중", "being started"),
    "spare_soon": ("곧 준비해요", "none yet: one is started in a moment"),
    "spare_later": (
        "아직 없음: 핵심 서버가 안정된 뒤에 준비해요",
        "none yet: one is started once the core has proven itself",
    ),
    "spare_outdated": (
        "디스크의 코드와 달라요 (`hardcore restart`로 바꿔요)",
        "not the code that is on the disk (`hardcore restart` takes it)",
    ),
    "behind_fence": ("더는 쓰지 못해요", "can write no more"),
    "gateway": ("관문", "Gateway"),
    "sentinel": ("감시자", "Sentinel"),
    "budget": ("재시작", "Restarts"),
    "incident": ("사건", "Incident"),
    "last_incident": ("지난 사건", "Last incident"),
    "dead_letters": ("따로 보관한 요청", "Set aside"),
    "dead_letters_aside": ("{count}건 (`hardcore dlq`로 봐요)", "{count} (see `hardcore dlq`)"),
    "verified": ("장부 확인", "Ledger checked"),
    "backup": ("백업", "Backup"),
    "backup_kept": ("{made_at} (모두 {count}개)", "{made_at} ({count} kept)"),
    "safe": ("읽기만 하는 이유", "Reads only"),
    "safe_by": ("안전 모드", "Safe mode"),
    "safe_by_operator": (
        "켜져 있음 (`hardcore safe-mode off`로 꺼요)",
        "on (`hardcore safe-mode off` ends it)",
    ),
    "mode": ("모드", "Mode"),
    "mode_assist": ("assist: 알리고 기다려요", "assist: it tells you and waits"),
    "mode_observe": ("observe: 기록만 해요", "observe: it only records"),
    "policy_fault": ("정책 파일", "Policy file"),
    "needs_since": ("기다린 때", "Waits since"),
    "forecast": ("예측", "Forecast"),
    "part": ("멈춘 부분", "Silent part"),
    "part_silent": (
        "{name}: 신호가 {age_ms} ms째 없음 (한도 {limit_ms} ms)",
        "{name}: no sign for {age_ms} ms (limit {limit_ms} ms)",
    ),
    "start_fault": ("켜지 못한 까닭", "Start failed"),
    "switch_fault": ("바꾸지 못한 까닭", "Not switched"),
    "estimate": ("예상 시간", "Estimates"),
    "estimate_none": ("아직 맞춰 본 적 없음", "none has been put to the test yet"),
    "estimate_score": (
        "예상한 {scored}번 중 {within}번 맞음 (기록 {samples}번)",
        "{within} of {scored} came true ({samples} ways back on record)",
    ),
    "worry": ("걱정되는 점", "Worry"),
    "none": ("없음", "none"),
    "epoch": ("세대", "epoch"),
    "in_flight": ("처리 중", "in flight"),
    "held": ("기다리는 요청", "waiting"),
    "beat": ("박동", "beat"),
    "budget_used": ("{window_s}초 동안 {used}번 (한도 {limit}번)", "{used} in {window_s} s, {limit} allowed"),
    "next": ("다음 할 일", "Next step"),
    "stopped": ("꺼져 있음 (`hardcore up`으로 다시 켜요)", "stopped, as asked (`hardcore up` starts it)"),
}


#: Why no spare is kept -> (ko, en)
SPARE_LACKS: Final[dict[str, tuple[str, str]]] = {
    "off": (
        "없음: 꺼 두었어요 (정책의 `spare` 또는 `up --no-spare`)",
        "none: it is turned off (`spare` in the policy, or `up --no-spare`)",
    ),
    "memory": (
        "없음: 빈 메모리가 모자라요 (정책의 `spare_memory_mb`). 멈추면 새로 켜는 동안 기다려요",
        "none: too little memory is free (`spare_memory_mb` in the policy). A restart takes longer",
    ),
    "died": (
        "없음: 지난번에 켜지 못했어요. 그사이 멈추면 돌아오는 데 더 걸려요. 까닭: {why}",
        "none: the last one failed; another is tried. Until then a way back takes longer. Why: {why}",
    ),
}


def spare_lack(lack: str, lang: str, why: str = "") -> str:
    """Return why no spare is kept, in words. `why`: what became of the last one."""
    return SPARE_LACKS[lack][LANGUAGES.index(lang)].format(why=why)


#: What to do when the guard waits for a person: why -> (ko, en)
NEXT_STEPS: Final[dict[str, tuple[str, str]]] = {
    "CRASH_LOOP": (
        "같은 문제가 되풀이돼서 멈췄어요. `hardcore incidents`를 보고 `hardcore resume`으로 다시 해 보세요.",
        "The same thing kept happening. Look at `hardcore incidents`, then `hardcore resume`.",
    ),
    "STORE_CORRUPT": (
        "장부가 마지막으로 확인된 것과 달라요. 입력하지 말고 `hardcore verify`와 docs/recover.md를 보세요.",
        "The ledger is not what was last seen. Don't write; see `hardcore verify` and docs/recover.md.",
    ),
    "CONFIG_INVALID": (
        "설정 때문에 켤 수 없어요. `hardcore incidents`에서 이유를 보고 고친 뒤 `hardcore resume`을 하세요.",
        "It can't start as it is set up. `hardcore incidents` says why; mend it, then `hardcore resume`.",
    ),
    "DB_LOCKED": (
        "다른 프로그램이 장부를 잠그고 있어요. 그 프로그램을 닫고 `hardcore resume`을 하세요.",
        "Another program holds the ledger's lock. Close it, then `hardcore resume`.",
    ),
    "DISK_FULL": (
        "장부가 있는 디스크가 가득 찼어요. 자리를 만들면 저절로 다시 쓸 수 있어요. 지금은 읽기만 돼요.",
        "The ledger's disk is full. Make room and it writes again by itself; until then it can be read.",
    ),
    "DISK_READ_ONLY": (
        "장부가 있는 디스크에 쓸 수 없어요. 다시 쓸 수 있게 하면 저절로 이어져요. 지금은 읽기만 돼요.",
        "The ledger's disk takes no write. Make it writable and it goes on by itself; until then it can be read.",
    ),
    "DISK_STALLED": (
        "장부가 있는 디스크가 대답하지 않아요. 디스크를 확인하세요. 돌아오면 저절로 이어져요.",
        "The ledger's disk does not answer. Look at the disk; it goes on by itself when that is back.",
    ),
    "OPERATOR": (
        "안전 모드예요. `hardcore safe-mode off`로 끝내요.",
        "The safe mode is on. `hardcore safe-mode off` ends it.",
    ),
    "UNKILLABLE": (
        "핵심 서버가 아직 끝나지 않았어요. 계속 끝내 보고 있어요. 디스크에 문제가 없는지 확인하세요.",
        "The old core has not ended yet; the kill is repeated. Check the disk.",
    ),
}
_NEXT_STEP: Final = (
    "`hardcore incidents`에서 이유를 보고 `hardcore resume`으로 다시 해 보세요.",
    "`hardcore incidents` says why; `hardcore resume` tries again.",
)


def next_step(why: str | None, lang: str) -> str:
    """Return what a person should do when the guard waits for one."""
    return NEXT_STEPS.get(why or "", _NEXT_STEP)[LANGUAGES.index(lang)]


def refused_words(answer: Mapping[str, Any], lang: str) -> str:
    """Return why the guard said no, in a language where it has one; else in the guard's own words."""
    known = REFUSALS.get(str(answer.get("code")))
    if known is None:
        return str(answer.get("error"))
    return known[LANGUAGES.index(lang)].format_map(answer.get("values") or {})


def label(key: str, lang: str) -> str:
    """Return a label of the status page."""
    return LABELS[key][LANGUAGES.index(lang)]


def state_words(state: str, lang: str) -> str:
    """Return a state in words for people."""
    return STATES[state][LANGUAGES.index(lang)]
