"""A router's log, as Zenoh writes it, tells who was refused what; not what would be refused."""

from __future__ import annotations

import pytest

from milepost.security.refusals import MOST_OF_ONE, SAY_EVERY_S, Refusals

HEAD = "\x1b[2m2026-11-28T05:22:01.{:06d}Z\x1b[0m \x1b[35mTRACE\x1b[0m rx-{thread} ThreadId({thread:02d}) \x1b[2mzenoh::net::routing::interceptor::access_control\x1b[0m\x1b[2m:\x1b[0m "  # noqa: E501
ZID = "af01"
KEY = "milepost/v1/full-1/state"
ACTIONS = ("Query", "Reply", "Put", "Delete", "Declare/Undeclare Subscriber", "Declare/Undeclare Queryable",
           "Declare/Undeclare Liveliness Token", "Liveliness Query", "Declare Liveliness Subscriber")  # fmt: skip


class Log:
    def __init__(self) -> None:
        self.said: list[tuple[str, str]] = []
        self.now_s = 0.0
        self.refusals = Refusals(lambda code, text: self.said.append((code, text)), lambda: self.now_s)

    def line(self, text: str, thread: int = 1) -> bool:
        return self.refusals.line(HEAD.format(1, thread=thread) + text)

    def seen_first(self, key: str = KEY, thread: int = 1) -> None:
        """What Zenoh traces when a session first names a key that it may not use."""
        for flow in ("ingress", "egress"):
            self.line(f"ACL ({flow}): caching permissions for `{key}` ...", thread)
            for action in ACTIONS:
                self.acted(action, flow, key, thread)

    def acted(self, action: str, flow: str = "ingress", key: str = KEY, thread: int = 1, who: str = "sensor-radar") -> None:
        subject = f"Interface(lo)+CertCommonName({who})+Transport(Tls)+{ZID}"
        self.line(f"{ZID} on {subject} is unauthorized to {action} ({flow}) on {key}", thread)

    def cached(self, action: str = "Put", zid: str = ZID, un: str = "un") -> None:
        self.line(f"Using cached result: {zid} is {un}authorized to {action} (ingress) on {KEY}")


@pytest.fixture
def log() -> Log:
    return Log()


def test_naming_a_key_is_no_refusal_and_using_it_is(log: Log) -> None:
    log.seen_first()
    assert log.said == []
    log.cached()
    assert log.said == [("access_refused", f"sensor-radar may not put {KEY}")]


def test_a_key_that_was_never_declared_is_refused_too_beside_another_thread_that_looks(log: Log) -> None:
    log.line(f"ACL (ingress): caching permissions for `{KEY}` ...", thread=2)
    log.acted("Put", thread=1)
    assert log.said == [("access_refused", f"sensor-radar may not put {KEY}")]
    for action in ACTIONS:
        log.acted(action, thread=2)
    assert len(log.said) == 1


def test_what_goes_out_or_is_allowed_is_no_refusal(log: Log) -> None:
    log.acted("Put", "egress")
    log.cached(un="")
    assert log.said == []


def test_a_repeated_refusal_is_counted_and_said_every_ten_seconds(log: Log) -> None:
    for _ in range(500):
        log.acted("Put")
    assert len(log.said) == 1
    log.refusals.rest()
    assert len(log.said) == 1
    log.now_s = SAY_EVERY_S
    log.refusals.rest()
    assert log.said[1:] == [("access_refused", f"sensor-radar may not put {KEY} (500 times)")]
    log.now_s = 2 * SAY_EVERY_S
    log.refusals.rest()
    assert len(log.said) == 2


def test_ever_new_keys_neither_fill_the_memory_nor_hide_what_others_do(log: Log) -> None:
    for i in range(1000):
        log.acted("Put", key=f"{KEY}/{i}")
    assert len(log.refusals.counts) == MOST_OF_ONE + 1
    assert sum(count.total for count in log.refusals.counts.values()) == 1000
    assert log.said[-1] == ("access_refused", "sensor-radar may not use further keys")
    log.acted("Put", who="sensor-imu")
    assert log.said[-1] == ("access_refused", f"sensor-imu may not put {KEY}")


@pytest.mark.parametrize(
    ("why", "said"),
    [
        ("peer sent no certificates", "peer sent no certificates"),
        ("invalid peer certificate: BadSignature", "invalid peer certificate: BadSignature"),
        (
            "invalid peer certificate: certificate expired: verification time 1795842602 (UNIX), but certificate is not valid",
            "invalid peer certificate: certificate expired",
        ),
        ("received corrupt message of type InvalidContentType", "received corrupt message of type InvalidContentType"),
    ],
)
def test_a_connection_that_was_refused_says_why(log: Log, why: str, said: str) -> None:
    head = "\x1b[2m2026-11-28T05:10:02.329491Z\x1b[0m \x1b[33m WARN\x1b[0m acc-0 ThreadId(05) \x1b[2mzenoh_link_tls::unicast\x1b[0m\x1b[2m:\x1b[0m "  # noqa: E501
    assert log.refusals.line(f"{head}{why}. Hint: increase the system open file limit.")
    assert log.said == [("connection_refused", f"a connection was refused: {said}")]


def test_another_line_is_left_to_be_shown(log: Log) -> None:
    assert not log.refusals.line("WARN zenoh::net::runtime: something else")
    assert log.said == []
