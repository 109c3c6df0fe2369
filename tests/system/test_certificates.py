"""What certificates do to sessions: nobody reads along, and who has no valid one any more is out."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh

from conftest import free_port
from milepost.config.train import load_train
from milepost.runtime import zenoh_config

pytest.importorskip("cryptography")
from milepost.security.authority import Authority
from milepost.security.bundle import Bundle

pytestmark = pytest.mark.long

TRAIN = load_train(Path(__file__).parents[2] / "deploy" / "trains" / "metro.yaml")
KEY = f"milepost/v1/{TRAIN.name}/state"
SECRET = b"position_m and everything else that a state says"
SHORT_S = 4.0
DAY_S = 86400.0


class Eavesdropper:
    """Passes on the bytes between a client and a router, and keeps them."""

    def __init__(self, port: int) -> None:
        self.heard = bytearray()
        self._port = port
        self._door = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._door.getsockname()[1]
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        while True:
            try:
                one, _ = self._door.accept()
            except OSError:
                return
            other = socket.create_connection(("127.0.0.1", self._port))
            for origin, target in ((one, other), (other, one)):
                threading.Thread(target=self._pass, args=(origin, target), daemon=True).start()

    def _pass(self, origin: socket.socket, target: socket.socket) -> None:
        try:
            while part := origin.recv(65536):
                self.heard += part
                target.sendall(part)
        except OSError:
            pass
        finally:
            target.close()

    def close(self) -> None:
        self._door.close()


@pytest.fixture(scope="module")
def secure(tmp_path_factory) -> Iterator[tuple[Bundle, int]]:
    """A secure router alone, and its port."""
    port = free_port()
    bundle = Bundle(tmp_path_factory.mktemp("pki") / "metro-1", TRAIN)
    bundle.create(7.0, ["127.0.0.1"])
    bundle.write_sessions([f"tls/127.0.0.1:{port}"], [f"tls/127.0.0.1:{port}"])
    command = ["run", "router", "--config", str(bundle.session("router")), "--parent", str(os.getpid())]
    process = subprocess.Popen([sys.executable, "-m", "milepost", *command])
    yield bundle, port
    process.send_signal(signal.SIGTERM)
    assert process.wait(5.0) == 0


def opened(config: dict):
    return zenoh.open(zenoh.Config.from_json5(json.dumps(config)))


def overheard(sender: dict, receiver: dict, port: int) -> bytes:
    """What somebody between a publisher and its router hears, until the secret has come out at the other side."""
    spy = Eavesdropper(port)
    protocol = sender["connect"]["endpoints"][0].split("/")[0]
    came = threading.Event()
    through = {**sender, "connect": {**sender["connect"], "endpoints": [f"{protocol}/127.0.0.1:{spy.port}"]}}
    with opened(receiver) as listening, opened(through) as sending:
        kept = listening.declare_subscriber(KEY, lambda sample: came.set() if sample.payload.to_bytes() == SECRET else None)
        publisher = sending.declare_publisher(KEY)
        deadline = time.monotonic() + 10.0
        while not came.wait(0.1):  # the router may not know the subscriber yet
            publisher.put(SECRET)
            assert time.monotonic() < deadline
        del kept
    spy.close()
    return bytes(spy.heard)


def test_an_eavesdropper_hears_everything_from_an_open_router_and_nothing_from_a_secure_one(secure, router) -> None:
    bundle, port = secure
    sender, receiver = (zenoh_config.client(bundle.session(name)) for name in ("fuser", "dispatch"))
    closed = overheard(sender, receiver, port)
    open_one = zenoh_config.client([router])
    plain = overheard(open_one, open_one, int(router.rpartition(":")[2]))
    for word in (SECRET, b"milepost", TRAIN.name.encode(), b"state"):
        assert word in plain, "else the other half proves nothing"
        assert word not in closed
    assert len(closed) > len(SECRET)


@pytest.mark.parametrize("renewed", [True, False], ids=["renewed", "not renewed"])
def test_a_session_ends_with_its_certificate_and_goes_on_with_a_new_one(secure, renewed: bool) -> None:
    bundle, _ = secure
    bundle.issue(["fuser"], SHORT_S / DAY_S)
    end_s = time.time() + SHORT_S
    came: list[float] = []
    news = threading.Condition()

    def receive(sample) -> None:
        with news:
            came.append(time.time())
            news.notify_all()

    with opened(zenoh_config.client(bundle.session("dispatch"))) as listening:
        kept = listening.declare_subscriber(KEY, receive)
        with opened(zenoh_config.client(bundle.session("fuser"))) as sending:
            publisher = sending.declare_publisher(KEY)
            if renewed:
                bundle.issue(["fuser"], 7.0)
            while time.time() < end_s + 3.0:
                publisher.put(SECRET)
                time.sleep(0.02)  # as often as a state
            del publisher
        del kept
    assert any(at < end_s for at in came), "it worked before"
    after = [at for at in came if at > end_s + 1.0]
    gap_s = max(b - a for a, b in zip(came, [*came[1:], end_s + 3.0], strict=True))
    print(f"certificate renewed: {renewed}, longest gap {gap_s:.3f} s")
    assert bool(after) == renewed
    Authority.load(bundle.folder).issue(bundle.folder / "fuser", "fuser", 7.0)


def test_the_certificate_of_a_process_cannot_stand_for_a_router(secure) -> None:
    bundle, _ = secure
    port = free_port()
    stolen = zenoh_config.router([f"tls/127.0.0.1:{port}"])
    tls = zenoh_config.client(bundle.session("fuser"))["transport"]["link"]["tls"]
    identity = tls["connect_certificate"]
    stolen["transport"]["link"]["tls"] = {**tls, "listen_certificate": identity, "listen_private_key": identity}
    victim = zenoh_config.tool(bundle.session("dispatch"), 1500)
    victim["connect"]["endpoints"] = [f"tls/127.0.0.1:{port}"]
    with opened(stolen), pytest.raises(zenoh.ZError, match="Unable to connect"):
        opened(victim)
