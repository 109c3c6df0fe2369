"""Connections that bring nothing are found and made anew."""

from __future__ import annotations

import json
import os
import socket
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import pytest
import zenoh

from milepost.chaos.running import free_port
from milepost.runtime import zenoh_config
from milepost.runtime.bus import open_session
from milepost.runtime.sessions.hearing import MOST_SILENCES, Hearing, Look, ask_router, cut, look_for_routers

A, B = frozenset({"a"}), frozenset({"b"})
NOBODY: frozenset[str] = frozenset()
SILENT = [Look(A, A)] * MOST_SILENCES


def cuts(*looks: Look) -> list[list[str]]:
    hearing = Hearing()
    return [hearing.deaf_to(look) for look in looks]


def places_of_cuts(*looks: Look) -> list[int]:
    return [place for place, found in enumerate(cuts(*looks), start=1) if found]


def test_a_neighbour_that_is_silent_for_long_is_cut() -> None:
    assert cuts(*SILENT) == [*[[]] * (MOST_SILENCES - 1), ["a"]]


def test_one_that_stays_silent_is_cut_after_twice_as_many_each_time() -> None:
    assert places_of_cuts(Look(A, NOBODY), *SILENT * 32) == [4, 10, 22, 46, 94]


def test_one_that_was_never_heard_is_left_alone_after_three_cuts() -> None:
    """A router that is not Milepost's shows no token, and its link is a good one."""
    assert places_of_cuts(*SILENT * 100) == [3, 9, 21]


def test_one_that_was_heard_since_is_cut_as_soon_as_the_first_time() -> None:
    assert places_of_cuts(*SILENT, Look(A, NOBODY), *SILENT) == [3, 7]


def test_one_answer_in_between_is_enough() -> None:
    nearly = [Look(A, A)] * (MOST_SILENCES - 1)
    assert not any(cuts(*nearly, Look(A, NOBODY), *nearly, Look(A, NOBODY)))


def test_a_neighbour_that_went_meanwhile_begins_anew() -> None:
    nearly = [Look(A, A)] * (MOST_SILENCES - 1)
    assert not any(cuts(*nearly, Look(NOBODY, NOBODY), *nearly))


def test_neighbours_are_counted_apart() -> None:
    assert cuts(*[Look(A | B, B)] * MOST_SILENCES)[-1] == ["b"]


@contextmanager
def sessions(*configs: dict[str, Any]) -> Iterator[list[Any]]:
    with ExitStack() as stack:
        yield [stack.enter_context(open_session(config)) for config in configs]


def endpoint() -> str:
    return f"tcp/127.0.0.1:{free_port()}"


def wait_until(what: Callable[[], bool], within_s: float = 10.0) -> None:
    end = time.monotonic() + within_s
    while not what():
        assert time.monotonic() < end
        time.sleep(0.01)


def test_a_client_hears_its_router_and_one_without_a_router_has_no_neighbour() -> None:
    at = endpoint()
    with sessions(zenoh_config.router([at]), zenoh_config.client([at])) as (router, client):
        assert ask_router(client) == Look(frozenset({str(router.info.zid())}), NOBODY)
        router.close()
        wait_until(lambda: ask_router(client) == Look(NOBODY, NOBODY))


def test_a_connection_that_is_cut_is_made_anew_and_what_was_declared_is_there_again() -> None:
    at = endpoint()
    with sessions(zenoh_config.router([at]), zenoh_config.client([at])) as (router, client):
        seen: list[Any] = []
        watching = router.liveliness().declare_subscriber("who/*", lambda sample: seen.append(sample.kind), history=True)
        token, heard = client.liveliness().declare_token("who/client"), []
        subscriber = client.declare_subscriber("said", lambda sample: heard.append(sample))
        wait_until(lambda: seen == [zenoh.SampleKind.PUT])
        assert cut(client, str(router.info.zid())) == 1
        wait_until(lambda: seen == [zenoh.SampleKind.PUT, zenoh.SampleKind.DELETE, zenoh.SampleKind.PUT])

        def says_and_is_heard() -> bool:
            router.put("said", b"")
            return bool(heard)

        wait_until(says_and_is_heard)
        for each in (watching, token, subscriber):
            each.undeclare()


def test_linked_routers_hear_each_other_again_after_a_cut() -> None:
    one, two = endpoint(), endpoint()
    with sessions(zenoh_config.router([one]), zenoh_config.router([two], [one])) as (first, second):
        linked = Look(frozenset({str(first.info.zid())}), NOBODY)
        wait_until(lambda: look_for_routers(second) == linked)
        links = [link.src for link in second.info.links()]
        assert cut(second, str(first.info.zid())) == 1
        wait_until(lambda: look_for_routers(second) == linked and [link.src for link in second.info.links()] != links)


def test_a_cut_opens_no_files_and_touches_no_other_connection(tmp_path: Path) -> None:
    at = endpoint()
    one, two = socket.socketpair()
    with (
        one,
        two,
        (tmp_path / "file").open("wb"),
        sessions(zenoh_config.router([at]), zenoh_config.client([at])) as (_, client),
    ):
        before = set(os.listdir("/proc/self/fd"))
        for _ in range(50):
            cut(client, "0")
        assert len(set(os.listdir("/proc/self/fd")) - before) <= 1
        one.send(b"x")
        assert two.recv(1) == b"x"


def test_only_the_neighbour_asked_for_is_cut() -> None:
    at = endpoint()
    with sessions(zenoh_config.router([at]), zenoh_config.client([at])) as (router, client):
        assert cut(client, "0") == 0
        assert ask_router(client).neighbours == {str(router.info.zid())}


def test_a_router_that_shows_no_token_is_silent() -> None:
    one, two = endpoint(), endpoint()
    with (
        zenoh.open(zenoh.Config.from_json5(json.dumps(zenoh_config.router([one])))) as stranger,
        zenoh.open(zenoh.Config.from_json5(json.dumps(zenoh_config.router([two], [one])))) as ours,
    ):
        of_stranger = frozenset({str(stranger.info.zid())})
        wait_until(lambda: look_for_routers(ours) == Look(of_stranger, of_stranger))


@pytest.mark.parametrize("mode", ["client", "router"])
def test_a_deaf_connection_is_cut_by_the_session_itself(mode: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nobody can make Zenoh deaf at will: here the look says so."""
    one, two = endpoint(), endpoint()
    looks = {mode: lambda session: Look(*[frozenset(str(each) for each in session.info.routers_zid())] * 2)}
    monkeypatch.setattr("milepost.runtime.sessions.hearing.LOOKS", looks)
    monkeypatch.setattr("milepost.runtime.sessions.hearing.EVERY_S", 0.05)
    config = zenoh_config.client([one]) if mode == "client" else zenoh_config.router([two], [one])
    with sessions(zenoh_config.router([one])) as (router,), sessions(config) as (session,):
        wait_until(lambda: bool(session.info.links()))
        begun = str(session.info.links()[0].src)
        wait_until(lambda: bool(links := session.info.links()) and str(links[0].src) != begun)
        assert str(session.info.links()[0].zid) == str(router.info.zid())


def test_an_error_of_one_look_does_not_end_the_looking(monkeypatch: pytest.MonkeyPatch) -> None:
    looks = []

    def look(session: Any) -> Look:
        looks.append(session)
        raise zenoh.ZError("the connection ended meanwhile")

    monkeypatch.setattr("milepost.runtime.sessions.hearing.LOOKS", {"client": look})
    monkeypatch.setattr("milepost.runtime.sessions.hearing.EVERY_S", 0.01)
    at = endpoint()
    with sessions(zenoh_config.router([at]), zenoh_config.client([at])):
        wait_until(lambda: len(looks) >= 3)
