"""Live latency and load of the default train, beside a raw relay chain of the same number of hops."""

from __future__ import annotations

import json
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import msgpack
import numpy as np
import psutil
import yaml
import zenoh

from milepost.runtime.zenoh_config import Connection, client

STEADY_S = 10.0
WINDOW_S = 8.0
MAGLEV, FULL = "deploy/trains/maglev.yaml", "deploy/trains/full.yaml"
TRAIN = "maglev-1"
# the rate of the slowest speed sensor of the default train; GNSS is slower
SPEED_HZ = 20.0


def free_endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@contextmanager
def processes(*commands: list[str]) -> Iterator[list[subprocess.Popen]]:
    started = [subprocess.Popen([sys.executable, *command], stderr=subprocess.DEVNULL) for command in commands]
    try:
        yield started
    finally:
        for process in reversed(started):
            process.send_signal(signal.SIGTERM)
        for process in reversed(started):
            process.wait(10.0)


def summary(latencies_ms: list[float]) -> dict[str, float]:
    return {
        "p50_ms": float(np.percentile(latencies_ms, 50)),
        "p99_ms": float(np.percentile(latencies_ms, 99)),
        "count": len(latencies_ms),
    }


def measure_train(seconds: float, state_dir: Path | None = None) -> tuple[dict[str, float], float]:
    """From the publication of the radar reading at an epoch to that epoch's state outside; and the cores in use.

    `state_dir`: where a secure train keeps its certificates; without it the train is open.
    """
    endpoint = free_endpoint()
    secure = [] if state_dir is None else ["--secure", "--state-dir", str(state_dir)]
    connection: Connection = [endpoint] if state_dir is None else certificates(state_dir, endpoint)
    published: dict[int, int] = {}
    received: dict[int, int] = {}
    first = threading.Event()

    def reading(sample) -> None:
        message = msgpack.unpackb(sample.payload.to_bytes())
        published[message["measured_at_ns"]] = message["published_at_ns"]

    def state(sample) -> None:
        now = time.time_ns()
        received[msgpack.unpackb(sample.payload.to_bytes())["measured_at_ns"]] = now
        first.set()

    with processes(["-m", "milepost", "up", "--train", MAGLEV, "--headless", "--listen", endpoint, *secure]) as (up,):
        with zenoh.open(zenoh.Config.from_json5(json.dumps(client(connection)))) as session:
            kept = session.declare_subscriber(f"milepost/v1/{TRAIN}/state", state)
            if not first.wait(60.0):
                raise RuntimeError("the train sent no state within a minute")
            kept_too = session.declare_subscriber(f"milepost/v1/{TRAIN}/reading/radar", reading)
            time.sleep(2.0)
            begin = time.time_ns()
            time.sleep(seconds)
            del kept, kept_too
        latencies = [(received[at] - published[at]) / 1e6 for at in received if at in published and at >= begin]
        load = measure_load(up.pid) if seconds >= WINDOW_S else 0.0
    return summary(latencies), load


def certificates(state_dir: Path, endpoint: str) -> Path:
    """The session file of a tool that reads; made here, so that a session can be opened before the train is there."""
    from milepost.config.train import load_train
    from milepost.security.bundle import certified

    return certified(load_train(Path(MAGLEV)), state_dir, [endpoint.replace("tcp/", "tls/")])("dispatch")


def measure_security(pairs: int) -> dict[str, float]:
    """Latency and cores of a train without and with certificates, in turn: medians."""
    found: dict[str, list[tuple[dict[str, float], float]]] = {"open": [], "secure": []}
    with tempfile.TemporaryDirectory() as folder:
        for _ in range(pairs):
            found["open"].append(measure_train(WINDOW_S))
            found["secure"].append(measure_train(WINDOW_S, Path(folder)))
    out = {}
    for name, runs in found.items():
        for figure in ("p50_ms", "p99_ms"):
            out[f"{name}_{figure}"] = float(np.median([latency[figure] for latency, _ in runs]))
        out[f"{name}_cores"] = float(np.median([cores for _, cores in runs]))
    return out


def measure_startup(runs: int) -> dict[str, float]:
    """Medians of the time from the command to the first state of the train with everything, and of the memory of it all."""
    found = []
    for _ in range(runs):
        with tempfile.TemporaryDirectory() as folder:
            report = Path(folder) / "report.json"
            command = ["up", "--headless", "--train", FULL, "--duration", "5", "--report", str(report)]
            subprocess.run(
                [sys.executable, "-m", "milepost", *command, "--listen", free_endpoint()],
                stderr=subprocess.DEVNULL,
                check=True,
                timeout=120.0,
            )
            found.append(json.loads(report.read_text(encoding="utf-8")))
    return {name: float(np.median([each[name] for each in found])) for name in ("first_state_s", "memory_pss_mib")}


def measure_full_load(train: str = FULL) -> dict[str, float]:
    """Cores used by the train with everything, in steady state; and before that, the epochs of which no state came outside."""
    endpoint = free_endpoint()
    epochs: list[int] = []
    first = threading.Event()

    def state(sample) -> None:
        epochs.append(msgpack.unpackb(sample.payload.to_bytes())["epoch"])
        first.set()

    with processes(["-m", "milepost", "up", "--train", train, "--headless", "--listen", endpoint]) as (up,):
        with zenoh.open(zenoh.Config.from_json5(json.dumps(client([endpoint])))) as session:
            kept = session.declare_subscriber("milepost/v1/*/state", state)
            if not first.wait(60.0):
                raise RuntimeError("the train sent no state within a minute")
            time.sleep(2.0)
            del epochs[:-1]
            time.sleep(WINDOW_S)
            del kept
        seen = set(epochs)
        return {"load_cores": measure_load(up.pid), "missing_epochs": max(seen) - min(seen) + 1 - len(seen)}


def measure_fast_load(hz: float = 100.0) -> dict[str, float]:
    """The same with odometers, radars, loop and inertial unit at a higher rate."""
    train = yaml.safe_load(Path(FULL).read_text(encoding="utf-8"))
    train["line"] = str((Path(FULL).parent / train["line"]).resolve())
    for unit in train["units"].values():
        if unit.get("rate_hz", 0.0) >= SPEED_HZ:
            unit["rate_hz"] = hz
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "full-fast.yaml"
        path.write_text(yaml.safe_dump(train), encoding="utf-8")
        return measure_full_load(str(path))


def measure_load(pid: int) -> float:
    """Cores used by `up`, all processes of the train and its router, outside listeners gone, in steady state."""
    up = psutil.Process(pid)

    def spent() -> float:
        times = [process.cpu_times() for process in (up, *up.children(recursive=True))]
        return sum(t.user + t.system for t in times)

    time.sleep(max(0.0, STEADY_S - WINDOW_S))
    before, begun = spent(), time.monotonic()
    time.sleep(STEADY_S)
    return (spent() - before) / (time.monotonic() - begun)


def measure_raw(seconds: float) -> dict[str, float]:
    """The same three hops through a router, by Zenoh alone."""
    endpoint = free_endpoint()
    relay = [__file__.replace("live.py", "relay.py"), endpoint]
    latencies: list[float] = []
    first = threading.Event()

    def sink(sample) -> None:
        now = time.time_ns()
        latencies.append((now - struct.unpack("q", sample.payload.to_bytes()[:8])[0]) / 1e6)
        first.set()

    router = ["-m", "milepost", "run", "router", "--listen", endpoint]
    chain = [[*relay, "relay", "raw/0", "raw/1"], [*relay, "relay", "raw/1", "raw/2"], [*relay, "source", "none", "raw/0"]]
    with (
        processes(router, *chain),
        zenoh.open(zenoh.Config.from_json5(json.dumps(client([endpoint])))) as session,
    ):
        kept = session.declare_subscriber("raw/2", sink)
        if not first.wait(30.0):
            raise RuntimeError("the raw chain sent nothing within half a minute")
        time.sleep(2.0)
        latencies.clear()
        time.sleep(seconds)
        del kept
        return summary(list(latencies))
