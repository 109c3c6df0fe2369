"""What a recorder takes without a loss: `python -m tests.bench.recorder` floods one with readings, estimates and states."""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import psutil

from milepost.chaos.running import free_port
from milepost.config.shipped_files import find_file
from milepost.config.train import load_train
from milepost.recorder.reading import recordings_in
from milepost.recorder.summary import Summary
from milepost.runtime import zenoh_config
from milepost.runtime.bus import ZenohBus, open_session
from milepost.runtime.instances import live_tokens
from milepost_schemas import Message

TRAIN = "full"
INSTANCE = "bench"
AIM_HZ = 2000.0
UNITS = ("radar-front", "radar-rear", "loop", "odometer-front")
STREAMS = [*(("speed_reading", u) for u in UNITS), *(("estimate", u) for u in UNITS), ("state", "")]


def measure_recorder(rate_hz: float, for_s: float) -> dict[str, float]:
    """Messages sent and missing, the recorder's load in cores, and bytes written for a second."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with tempfile.TemporaryDirectory(prefix="milepost-bench-") as folder:
        router = milepost("run", "router", "--listen", endpoint)
        recorder = milepost(
            "run", "recorder", "--train", TRAIN, "--record", folder, "--connect", endpoint, "--least-free-mib", "0"
        )
        try:
            sent, busy_s = _send(endpoint, rate_hz, for_s, psutil.Process(recorder.pid))
            recorder.send_signal(signal.SIGTERM)
            assert recorder.wait(30.0) == 0
            size = sum(file.stat().st_size for file in Path(folder).iterdir())
            found = Summary().read(recordings_in(Path(folder)))
        finally:
            for process in (recorder, router):
                if process.poll() is None:
                    process.send_signal(signal.SIGTERM)
                process.wait(10.0)
    came = sum(run.came for sender, run in found.senders.items() if sender.instance == INSTANCE)
    return {
        "sent": sent,
        "missing": sent - came,
        "rate_hz": sent / for_s,
        "cores": busy_s / for_s,
        "written_kib_per_s": size / for_s / 1024,
    }


def _send(endpoint: str, rate_hz: float, for_s: float, recorder: psutil.Process) -> tuple[int, float]:
    """Send on four readings, four estimates and the state in turn; returns how many, and the processor time it took there."""
    train = load_train(find_file(Path(TRAIN), "trains"))
    with open_session(zenoh_config.client([endpoint])) as session:
        while not any(token.unit == "recorder" for token in live_tokens(session, train.name)):
            time.sleep(0.05)
        bus = ZenohBus(session, train.name)
        bodies = {row: body(row, train.name) for row, _ in STREAMS}
        before, begun, sent = sum(recorder.cpu_times()[:2]), time.monotonic(), 0
        while (spent_s := time.monotonic() - begun) < for_s:
            while sent < int(spent_s * rate_hz):
                sequence, which = divmod(sent, len(STREAMS))
                row, unit = STREAMS[which]
                bus.publish(row, unit, bodies[row].model_copy(update={"sequence": sequence, "unit": unit or "fuser"}))
                sent += 1
            time.sleep(0.001)
        time.sleep(1.0)
        return sent, sum(recorder.cpu_times()[:2]) - before


def body(row: str, train: str) -> Message:
    sys.path.insert(0, str(Path(__file__).parents[1]))
    from examples import EXAMPLES

    now = time.time_ns()
    head = {"train": train, "instance": INSTANCE, "measured_at_ns": now, "published_at_ns": now}
    return EXAMPLES[row][0].model_copy(update=head)


def milepost(*words: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen([sys.executable, "-m", "milepost", *words, "--parent", str(os.getpid())])


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.bench.recorder", description=__doc__)
    parser.add_argument("--rate", type=float, default=AIM_HZ, help="messages a second")
    parser.add_argument("--for", type=float, default=20.0, dest="for_s", help="seconds")
    parser.add_argument("--json", action="store_true", help="print JSON")
    options = parser.parse_args()
    found = measure_recorder(options.rate, options.for_s)
    if options.json:
        print(json.dumps(found))
        return
    print(
        f"recorder at {found['rate_hz']:.0f} messages a second: {found['missing']} of {found['sent']} missing (aim: 0 at 2000)"
    )
    print(f"its load {found['cores']:.2f} cores, {found['written_kib_per_s']:.0f} KiB/s written")


if __name__ == "__main__":
    main()
