"""The problems the gateway itself may answer with: their names, statuses and when to come again.

A closed list, because clients build on it (`type` is `/problems/<slug>`). The texts people read are in
`frontend/catalogue_gateway.py`; a test holds the two in step. One generic 503 was not chosen: whether a
request was done is the one thing its sender has to know.
"""

from enum import StrEnum


class Problem(StrEnum):
    """The slug of a problem."""

    BAD_REQUEST = "bad-request"
    REFUSED_PATH = "refused-path"
    WRONG_HOST = "wrong-host"
    FOREIGN_PAGE = "foreign-page"
    NOT_FOUND = "not-found"
    METHOD_NOT_ALLOWED = "method-not-allowed"
    REQUEST_TIMEOUT = "request-timeout"
    BODY_TOO_LARGE = "body-too-large"
    EXPECTATION_FAILED = "expectation-failed"
    HEAD_TOO_LARGE = "head-too-large"
    GATEWAY_FAULT = "gateway-fault"
    BROKEN_ANSWER = "broken-answer"
    RECOVERING = "recovering"
    NOT_DONE = "not-done"
    OUTCOME_UNKNOWN = "outcome-unknown"
    NOT_SERVING = "not-serving"
    SHUTTING_DOWN = "shutting-down"
    TOO_BUSY = "too-busy"
    CORE_TOO_SLOW = "core-too-slow"
    DRILL_REFUSED = "drill-refused"
    GUARD_AWAY = "guard-away"
    KEY_REUSED = "key-reused"
    NOT_KEEPABLE = "not-keepable"
    NOT_KEPT = "not-kept"
    PROMISE_UNKNOWN = "promise-unknown"
    RECEIPT_CANCELLED = "receipt-cancelled"
    RECEIPT_NOT_OPEN = "receipt-not-open"
    RECEIPTS_AWAY = "receipts-away"
    SET_ASIDE = "set-aside"
    SOURCE_STOPPED = "source-stopped"
    ADMIN_LOCAL = "admin-local"
    ADMIN_AWAY = "admin-away"
    ADMIN_BROKEN = "admin-broken"
    SIGN_IN_NEEDED = "sign-in-needed"
    NOT_ALLOWED = "not-allowed"
    TOKEN_WRONG = "token-wrong"  # noqa: S105  # a problem's name
    TRY_LATER = "try-later"
    AROUND_THE_PROXY = "around-the-proxy"
    NO_PASSWORD_SET = "no-password-set"  # noqa: S105  # as above
    ACCESS_UNREADABLE = "access-unreadable"


class Outcome(StrEnum):
    """What became of a request that was not simply answered by the core."""

    NOT_DONE = "not_done"
    UNKNOWN = "unknown"


STATUS: dict[Problem, int] = {
    Problem.BAD_REQUEST: 400,
    Problem.REFUSED_PATH: 400,
    Problem.WRONG_HOST: 421,
    Problem.FOREIGN_PAGE: 403,
    Problem.NOT_FOUND: 404,
    Problem.METHOD_NOT_ALLOWED: 405,
    Problem.REQUEST_TIMEOUT: 408,
    Problem.BODY_TOO_LARGE: 413,
    Problem.EXPECTATION_FAILED: 417,
    Problem.HEAD_TOO_LARGE: 431,
    Problem.GATEWAY_FAULT: 500,
    Problem.BROKEN_ANSWER: 502,
    Problem.RECOVERING: 503,
    Problem.NOT_DONE: 503,
    Problem.OUTCOME_UNKNOWN: 503,
    Problem.NOT_SERVING: 503,
    Problem.SHUTTING_DOWN: 503,
    Problem.TOO_BUSY: 503,
    Problem.CORE_TOO_SLOW: 504,
    Problem.DRILL_REFUSED: 409,
    Problem.GUARD_AWAY: 503,
    Problem.KEY_REUSED: 422,
    Problem.NOT_KEEPABLE: 422,
    Problem.NOT_KEPT: 503,
    Problem.PROMISE_UNKNOWN: 503,
    Problem.RECEIPT_CANCELLED: 409,
    Problem.RECEIPT_NOT_OPEN: 409,
    Problem.RECEIPTS_AWAY: 503,
    Problem.SET_ASIDE: 422,
    Problem.SOURCE_STOPPED: 429,
    Problem.ADMIN_LOCAL: 403,
    Problem.ADMIN_AWAY: 503,
    Problem.ADMIN_BROKEN: 502,
    Problem.SIGN_IN_NEEDED: 401,
    Problem.NOT_ALLOWED: 403,
    Problem.TOKEN_WRONG: 401,
    Problem.TRY_LATER: 429,
    Problem.AROUND_THE_PROXY: 403,
    Problem.NO_PASSWORD_SET: 403,
    Problem.ACCESS_UNREADABLE: 503,
}

#: Seconds after which asking again makes sense; a problem not named here carries no `Retry-After`.
RETRY_AFTER_S: dict[Problem, int] = {
    Problem.RECOVERING: 2,
    Problem.NOT_DONE: 1,
    Problem.OUTCOME_UNKNOWN: 2,
    Problem.NOT_SERVING: 30,
    Problem.SHUTTING_DOWN: 10,
    Problem.TOO_BUSY: 1,
    Problem.GUARD_AWAY: 2,
    Problem.NOT_KEPT: 2,
    Problem.PROMISE_UNKNOWN: 2,
    Problem.RECEIPTS_AWAY: 2,
    Problem.SOURCE_STOPPED: 60,  # unless it is known better
    Problem.ADMIN_AWAY: 5,
    Problem.TRY_LATER: 12,  # unless it is known better
    Problem.ACCESS_UNREADABLE: 30,
}

#: Problems that say enough by themselves: a request that could not be read was not done.
PLAIN = frozenset(
    {
        Problem.BAD_REQUEST,
        Problem.REFUSED_PATH,
        Problem.WRONG_HOST,
        Problem.FOREIGN_PAGE,
        Problem.METHOD_NOT_ALLOWED,
        Problem.EXPECTATION_FAILED,
        Problem.HEAD_TOO_LARGE,
        Problem.SIGN_IN_NEEDED,
        Problem.NOT_ALLOWED,
        Problem.TOKEN_WRONG,
        Problem.AROUND_THE_PROXY,
        Problem.NO_PASSWORD_SET,
        Problem.ACCESS_UNREADABLE,
    }
)
