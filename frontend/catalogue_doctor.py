"""What `hardcore doctor` says of a machine: one text for each finding, in Korean and English.

Plain data and one lookup. What is not well says what to do about it, or that nothing needs to be done.
"""

from typing import Final

LANGUAGES: Final = ("ko", "en")

#: key -> (ko, en)
DOCTOR: Final[dict[str, tuple[str, str]]] = {
    "kernel": ("리눅스 {release}, 파이썬 {python}", "Linux {release}, Python {python}"),
    "kernel_old": (
        "리눅스 {release}: 5.4 이상이 필요해요. 운영체제를 올려 주세요.",
        "Linux {release}: 5.4 or newer is needed. Update the system.",
    ),
    "threads": (
        "스레드가 무엇을 기다리는지 볼 수 있어요.",
        "What a thread waits for can be seen.",
    ),
    "threads_hidden": (
        "이 커널은 스레드가 무엇을 기다리는지 다 보여 주지 않아요. 멈춤을 더 늦게 판단해요.",
        "This kernel does not show everything a thread waits for: some hangs are judged later.",
    ),
    "data_missing": (
        "데이터 폴더가 아직 없어요: {path}. `hardcore up`을 하면 만들어져요.",
        "The data folder is not there yet: {path}. `hardcore up` makes it.",
    ),
    "data_not_writable": (
        "데이터 폴더에 쓸 수 없어요: {path} ({why}). 폴더의 주인과 권한, 디스크를 확인하세요.",
        "The data folder can't be written: {path} ({why}). Check its owner and mode, and the disk.",
    ),
    "room": ("디스크 여유: {free_mb}MB ({path})", "Room on the disk: {free_mb} MB ({path})"),
    "room_little": (
        "디스크 여유: {free_mb}MB ({path}). {floor_mb}MB보다 적어지면 읽기만 할 수 있어요 (disk_floor_mb).",
        "Room on the disk: {free_mb} MB ({path}). Below {floor_mb} MB (disk_floor_mb) the ledger only reads.",
    ),
    "room_untold": (
        "디스크가 여유를 알려 주지 않아요 ({path}). 그대로 두어도 돼요.",
        "The disk does not tell its room ({path}). Nothing needs to be done.",
    ),
    "room_none": (
        "디스크 여유가 {free_mb}MB뿐이에요 ({path}). {floor_mb}MB보다 적으면 읽기만 돼요 (disk_floor_mb). 자리를 만드세요.",
        "Only {free_mb} MB are free ({path}): below {floor_mb} MB (disk_floor_mb) the ledger only reads. Make room.",
    ),
    "in_memory": (
        "데이터 폴더가 메모리({kind}) 위에 있어요. 컴퓨터를 끄면 사라져요. --data로 디스크를 고르세요.",
        "The data folder lies in memory ({kind}) and is gone when the machine is switched off. Choose a disk with --data.",
    ),
    "far": (
        "데이터 폴더가 네트워크({kind}) 위에 있어요. 잠금을 믿을 수 없으니 이 컴퓨터의 디스크로 옮기세요.",
        "The data folder lies on a network ({kind}), where locks can't be trusted. Move it to a disk of this machine.",
    ),
    "file_system": ("파일 시스템: {kind}", "File system: {kind}"),
    "formats": (
        "직접 추가한 은행 형식 파일을 읽을 수 있어요 ({count}).",
        "The bank formats you have added can be read ({count}).",
    ),
    "format_faulty": (
        "은행 형식 {file} 파일에 고칠 곳이 있어요: {why}. 나머지 형식은 그대로 쓸 수 있어요.",
        "The bank format {file} needs mending: {why}. All other formats work.",
    ),
    "policy": ("정책 파일이 올바라요.", "The policy file is fine."),
    "policy_default": ("정책 파일이 없어서 기본값을 써요.", "There is no policy file: the defaults hold."),
    "policy_faulty": (
        "정책 파일에 고칠 곳이 있어요: {fault}. `hardcore policy check {path}`로 확인하세요.",
        "The policy file needs mending: {fault}. See `hardcore policy check {path}`.",
    ),
    "guard": ("감시자가 지켜보고 있어요 ({state}, pid {pid}).", "The sentinel watches ({state}, pid {pid})."),
    "guard_off": (
        "감시자가 돌고 있지 않아요. `hardcore up`으로 시작해요.",
        "No sentinel is running. `hardcore up` starts it.",
    ),
    "guard_silent": (
        "감시자가 있지만 대답하지 않아요. `hardcore up` 창을 확인하세요.",
        "The sentinel is there but does not answer. Look at the `hardcore up` window.",
    ),
    "agents": (
        "감시자가 사라지면 장부 서버와 관문이 새 감시자를 불러요.",
        "Should the sentinel be lost, the core and the gateway bring another.",
    ),
    "agents_blind": (
        "감시자가 사라져도 알 수 없어요. 없거나 맞지 않는 파일: {files}. `hardcore down` 뒤에 `hardcore up`을 해 주세요.",
        "Should the sentinel be lost, nobody would know: {files} is missing or another's. Do `hardcore down`, then `hardcore up`.",
    ),
    "agents_forbidden": (
        "감시자가 사라져도 런처만 새로 불러요 (정책의 SENTINEL_LOST에 REBOOT_PROCESS가 없어요).",
        "Should the sentinel be lost, only the launcher brings another (SENTINEL_LOST has no REBOOT_PROCESS in the policy).",
    ),
    "alerts": (
        "문제가 생기면 알릴 곳: {count}곳",
        "Told of trouble: {count} (`hardcore alerts test` tries them)",
    ),
    "alerts_nobody": (
        "문제가 생겨도 아무에게도 알리지 않아요 (정책의 alerts가 비어 있어요). docs/alerts.md 참고",
        "Nobody is told of trouble (`alerts` in the policy is empty). See docs/alerts.md.",
    ),
    "alerts_failing": (
        "마지막 알림이 가지 못했어요. 알림 번호: {channels}. `hardcore alerts test`로 확인하세요.",
        "The last alert did not get through by channel {channels}. See `hardcore alerts test`.",
    ),
    "alerts_muted": (
        "알림을 꺼 두었어요. 남은 시간: {minutes}분",
        "Alerts are muted for {minutes} more minutes.",
    ),
    "sqlite": ("SQLite {version}", "SQLite {version}"),
    "sqlite_race": (
        (
            "SQLite {version}: 두 프로그램이 한꺼번에 쓰면 파일이 상할 수 있는 버전이에요. 장부는 한 곳에서만 써서 괜찮지만, 다른 도구로는 켜져 있는"
            " 장부를 열지 마세요. 3.51.3부터 고쳐졌어요."
        ),
        (
            "SQLite {version} may damage a file that two programs write at one moment. The ledger has one writer only and is safe;"
            " open it with no other tool while it runs. Mended from 3.51.3 on."
        ),
    ),
    "door_here": (
        "이 컴퓨터 안에서만 열려요. 다른 기기에서 쓰려면 `hardcore passwd`부터 하세요.",
        "Only this machine is served. To use it from other devices, begin with `hardcore passwd`.",
    ),
    "door_closed": (
        "로그인해야 열려요 (사람 {people}명, 토큰 {tokens}개). 이 컴퓨터 안에서만 열려요.",
        "One has to sign in (people: {people}, tokens: {tokens}). Only this machine is served.",
    ),
    "door_open": (
        "로그인해야 열려요 (사람 {people}명, 토큰 {tokens}개). 다른 기기에도 열려 있고, 오가는 내용은 암호화돼요.",
        "One has to sign in (people: {people}, tokens: {tokens}). Other devices are served, and what is sent is encrypted.",
    ),
    "door_plain": (
        "다른 기기에 암호화 없이 열려 있어요 (--insecure-lan). 같은 망의 누구나 비밀번호를 엿볼 수 있어요.",
        "Other devices are served in the open (--insecure-lan): anybody on this network can read passwords.",
    ),
    "door_unreadable": (
        "{path} 파일을 읽지 못해서 아무도 로그인할 수 없어요 ({why}). 옮기고 `hardcore passwd`를 하세요.",
        "{path} can't be read, so nobody can sign in ({why}). Move it away and run `hardcore passwd`.",
    ),
    "door_files": (
        "{path} 파일을 읽을 수 없어요. 다음에 시작할 때 문이 열리지 않아요.",
        "{path} can't be read: the door will not open at the next start.",
    ),
    "backups": (
        "백업 {count}개, 가장 새것은 {hours}시간 전 것이에요. 가끔 다른 디스크에도 두세요 (hardcore backup --to 폴더).",
        "Backups: {count}, the newest {hours} h old. Keep one on another disk too (hardcore backup --to FOLDER).",
    ),
    "backups_later": (
        "백업은 장부를 쓰기 시작하면 날마다 스스로 만들어요.",
        "Backups are made each day by themselves, once the ledger is in use.",
    ),
    "backups_none": (
        "확인된 백업이 아직 없어요. 지금 `hardcore backup`을 하세요. 날마다 스스로도 만들어요.",
        "There is no proven backup yet. Run `hardcore backup` now; one is made each day by itself too.",
    ),
    "backups_old": (
        "가장 새 백업이 {days}일 전 것이에요 ({file}). `hardcore backup`을 하고, 안 되면 `hardcore logs`를 보세요.",
        "The newest backup is {days} days old ({file}). Run `hardcore backup`; if it fails, see `hardcore logs`.",
    ),
    "checkpoints": (
        "다시 켤 때 쓸 수 있는 장부 확인점: {count}개",
        "Checkpoints of the ledger that a start may go by: {count}",
    ),
    "checkpoints_none": (
        "장부 확인점이 아직 없어요. 거래가 쌓이면 저절로 생겨요.",
        "There is no checkpoint of the ledger yet; they come by themselves once something is booked.",
    ),
    "own_files": (
        "감시자의 기록 파일을 모두 읽을 수 있어요.",
        "What the guard keeps for itself can be read.",
    ),
    "own_files_broken": (
        "읽을 수 없는 기록 파일이 있어요: {files} ({path}). 감시자는 그 내용 없이 다시 시작해요. 원인이 디스크인지 확인하세요.",
        "Not readable in {path}: {files}. The guard goes on without what stood there. Check the disk.",
    ),
    "spare_waits": (
        "예비 서버가 기다리고 있어요 (pid {pid}).",
        "A spare core waits (pid {pid}).",
    ),
    "spare_room": (
        "예비 서버를 둘 수 있어요. 빈 메모리: {free_mb}MB (기준 {floor_mb}MB)",
        "A spare core can be kept here: {free_mb} MB of memory are free, {floor_mb} MB are asked for.",
    ),
    "spare_little": (
        "빈 메모리가 {free_mb}MB뿐이라 예비 서버를 두지 않아요 (기준 {floor_mb}MB, spare_memory_mb). 멈추면 새로 켜는 동안 기다려요.",
        "Only {free_mb} MB of memory are free, so no spare core is kept ({floor_mb} MB, spare_memory_mb): a way back takes longer.",
    ),
    "spare_off": (
        "예비 서버를 꺼 두었어요 (정책의 spare 또는 `up --no-spare`). 멈추면 새로 켜는 동안 기다려요.",
        "No spare core is kept, as asked (`spare` in the policy, or `up --no-spare`): a way back takes longer.",
    ),
    "spare_died": (
        "예비 서버를 켜지 못했어요 ({why}). logs/core.log 파일을 보고 고치세요. 그사이 멈추면 돌아오는 데 더 걸려요.",
        "The spare core failed ({why}). See logs/core.log and mend it; until then a way back takes longer.",
    ),
    "core_unstartable": (
        "디스크의 코드로 핵심 서버를 켤 수 없어요 ({why}). logs/core.log 파일을 보고 고치세요. 고치면 저절로 켜져요.",
        "The core can't be started ({why}). See logs/core.log and mend it; it is tried again by itself.",
    ),
    "spare_untold": (
        "이 컴퓨터는 빈 메모리를 알려 주지 않아서 예비 서버를 두지 않아요. 그대로 두어도 돼요.",
        "This machine does not tell its free memory, so no spare core is kept. Nothing needs to be done.",
    ),
    "stacks": (
        "멈춘 프로세스의 스택을 밖에서 읽을 수 있어요.",
        "The stacks of a stuck process can be read from outside.",
    ),
    "stacks_missing": (
        "py-spy가 없어서 스택을 밖에서 읽을 수 없어요. 핵심 서버가 스스로 적는 것으로 대신해요. 설치: pip install py-spy",
        "py-spy is not there, so stacks can't be read from outside; the core prints its own instead. To add it: pip install py-spy",
    ),
    "stacks_forbidden": (
        "스택을 밖에서 읽을 권한이 없어요 ({why}). 핵심 서버가 스스로 적는 것으로 대신해요. 그대로 두어도 돼요.",
        "Stacks may not be read from outside ({why}); the core prints its own instead. Nothing needs to be done.",
    ),
    "store": (
        "장부가 있는 PostgreSQL 서버에 연결돼요 (버전 {version}).",
        "The PostgreSQL server that the ledger lies in answers (version {version}).",
    ),
    "store_away": (
        "장부가 있는 PostgreSQL 서버를 쓸 수 없어요: {why}",
        "The PostgreSQL server that the ledger lies in can't be used: {why}",
    ),
    "image": (
        "메모리 전체를 파일로 남길 수 있어요 (정책의 memory_image를 켜면).",
        "Memory can be written out whole (if the policy's memory_image asks for it).",
    ),
    "image_missing": (
        "gcore가 없어서 메모리 전체를 파일로 남길 수 없어요. 필요하면 gdb를 설치하세요.",
        "gcore is not there, so memory can't be written out whole. Install gdb if you want that.",
    ),
    "oom": (
        "메모리 부족으로 끝난 것을 구별할 수 있어요 ({source}).",
        "An end for lack of memory can be told from others ({source}).",
    ),
    "oom_hidden": (
        "메모리 부족으로 끝난 것을 구별할 수 없어요. 밖에서 끝낸 것으로 적혀요.",
        "An end for lack of memory can't be told from a kill by somebody else here.",
    ),
    "files": ("열 수 있는 파일: {soft}개", "Open files allowed: {soft}"),
    "files_few": (
        "열 수 있는 파일이 {soft}개뿐이에요. 브라우저가 많으면 모자라요. `ulimit -n {least}` 뒤에 시작하세요.",
        "Only {soft} open files are allowed, too few for many browsers. Start after `ulimit -n {least}`.",
    ),
    "sum_good": ("지켜볼 준비가 됐어요.", "The guard can do its work here."),
    "sum_bad": ("BAD로 표시된 것부터 고쳐 주세요.", "Mend what is marked BAD first."),
}


def doctor_text(key: str, lang: str, **values: object) -> str:
    """Return a text in a language, its values filled in. A key that is missing is our own bug."""
    return DOCTOR[key][LANGUAGES.index(lang)].format_map(values)
