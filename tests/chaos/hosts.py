"""Hosts that are network namespaces of this machine, and cables between them that can be pulled out."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

LISTENER = """
import json, sys, time, msgpack, zenoh
config = zenoh.Config()
for name, value in (("mode", "client"), ("connect/endpoints", [sys.argv[1]]), ("scouting/multicast/enabled", False)):
    config.insert_json5(name, json.dumps(value))
def heard(sample):
    m = msgpack.unpackb(sample.payload.to_bytes())
    print(json.dumps([time.time_ns(), m["epoch"], m["measured_at_ns"], m["status"]]), flush=True)
with zenoh.open(config) as session:
    kept = session.declare_subscriber("milepost/v1/*/state", heard)
    sys.stdin.read()
"""


def ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True, capture_output=True, text=True, timeout=10.0)


def may_make_hosts() -> bool:
    """Whether this machine lets us make network namespaces."""
    name = f"milepost-{os.getpid()}"
    try:
        ip("netns", "add", name)
        ip("netns", "del", name)
    except (OSError, subprocess.SubprocessError):
        return False
    return True


@dataclass
class Host:
    """A network namespace; `states` are what a subscriber there has heard: received, epoch, measured, status."""

    name: str
    states: list[tuple[int, int, int, str]] = field(default_factory=list)
    processes: list[subprocess.Popen[Any]] = field(default_factory=list)

    def start(self, *words: str, **options: Any) -> subprocess.Popen[Any]:
        process = subprocess.Popen(["ip", "netns", "exec", self.name, sys.executable, *words], **options)
        self.processes.append(process)
        return process

    def milepost(self, *words: str) -> None:
        self.start("-m", "milepost", *words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)

    def listen(self, endpoint: str) -> None:
        process = self.start("-c", LISTENER, endpoint, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

        def read() -> None:
            assert process.stdout is not None
            self.states.extend(tuple(json.loads(line)) for line in process.stdout)

        threading.Thread(target=read, daemon=True).start()

    def end(self) -> None:
        for process in self.processes:
            process.send_signal(signal.SIGTERM)
        for process in self.processes:
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(15.0)


@dataclass(frozen=True)
class Cable:
    """Between two hosts; pulled out at the second one's end."""

    host: str
    port: str

    def out(self) -> None:
        ip("-n", self.host, "link", "set", self.port, "down")

    def plugged(self) -> None:
        ip("-n", self.host, "link", "set", self.port, "up")

    def out_for(self, seconds: float) -> int:
        """Pull it out for so long; returns when it was plugged in again, in ns."""
        self.out()
        try:
            time.sleep(seconds)
        finally:
            self.plugged()
        return time.time_ns()


@contextlib.contextmanager
def hosts_in_a_row(*names: str) -> Iterator[tuple[list[Host], list[Cable]]]:
    """Hosts, each with a cable to the next: the n-th has the addresses 10.79.n.1, and 10.79.(n-1).2 towards the one before."""
    hosts = [Host(f"mp{os.getpid() % 100000}-{name}") for name in names]
    made: list[Host] = []
    try:
        for host in hosts:
            ip("netns", "add", host.name)
            made.append(host)
            ip("-n", host.name, "link", "set", "lo", "up")
        cables = []
        for n, (near, far) in enumerate(pairwise(hosts)):
            ip("link", "add", f"c{n}", "netns", near.name, "type", "veth", "peer", "name", f"d{n}", "netns", far.name)
            for host, port, last in ((near, f"c{n}", 1), (far, f"d{n}", 2)):
                ip("-n", host.name, "addr", "add", f"10.79.{n}.{last}/24", "dev", port)
                ip("-n", host.name, "link", "set", port, "up")
            cables.append(Cable(far.name, f"d{n}"))
        yield hosts, cables
    finally:
        for host in reversed(made):
            host.end()
            with contextlib.suppress(subprocess.SubprocessError):
                ip("netns", "del", host.name)
