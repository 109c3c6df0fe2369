"""What the recorder of a fleet takes without a loss: `python -m tests.bench.fleet_recorder` sends it what they say, in bursts.

All trains of a fleet have their epochs at the same moments. Their own work is left out, which a small machine may not carry.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import signal
import tempfile
import time
from pathlib import Path

import psutil

from milepost.chaos.running import free_port
from milepost.config.shipped_files import find_file
from milepost.config.train import load_train
from milepost.recorder.incoming import head_of
from milepost.recorder.limits import Limits
from milepost.recorder.reading import McapReader, recordings_in
from milepost.runtime import zenoh_config
from milepost.runtime.bus import ZenohBus, open_session
from milepost.runtime.instances import live_tokens
from milepost.runtime.recording.process import RecorderOptions, run_recorders

from .recorder import INSTANCE, body, milepost

# what a regional train says each second
ROWS = ("speed_reading", "estimate", "state", "feedback", "health")
UNITS = tuple(f"unit-{n}" for n in range(6))
# the first messages of each key are written with their schema
WARM_S = 10


def record(trains: int, folder: Path, endpoint: str, parent: int) -> None:
    """Record trains `bench-1` to `bench-N` until stopped."""
    file = find_file(Path("metro"), "trains")
    made = [load_train(file, {"train": f"bench-{n + 1}"}) for n in range(trains)]
    run_recorders(made, RecorderOptions(folder, [endpoint], Limits(least_free_bytes=0), parent, several=True))


def measure_fleet_recorder(trains: int, rate_hz: float, for_s: float) -> dict[str, float]:
    """Messages sent and missing once it runs, the recorder's load in cores, and what a message takes of it."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    with tempfile.TemporaryDirectory(prefix="milepost-bench-") as name:
        router = milepost("run", "router", "--listen", endpoint)
        spawning = multiprocessing.get_context("spawn")
        recorder = spawning.Process(target=record, args=(trains, Path(name), endpoint, os.getpid()))
        recorder.start()
        try:
            sent, spent_s, busy_s = _send(endpoint, trains, rate_hz, for_s, psutil.Process(recorder.pid))
        finally:
            recorder.terminate()
            recorder.join(60.0)
            router.send_signal(signal.SIGTERM)
            router.wait(10.0)
        heads = [head_of(each.payload) for file in recordings_in(Path(name)) for each in McapReader(file).messages()]
    came = sum(head.instance == INSTANCE and head.sequence >= WARM_S for head in heads)
    return {
        "trains": trains,
        "sent": sent,
        "missing": sent - came,
        "rate_hz": sent / spent_s,
        "cores": busy_s / spent_s,
        "us_per_message": 1e6 * busy_s / max(came, 1),
    }


def _send(endpoint: str, trains: int, rate_hz: float, for_s: float, recorder: psutil.Process) -> tuple[int, float, float]:
    """Each second a burst of all trains' messages; returns how many, the time and the recorder's, all after the first ones."""
    names = [f"bench-{n + 1}" for n in range(trains)]
    with open_session(zenoh_config.client([endpoint])) as session:
        while not any(token.unit == "recorder" for token in live_tokens(session, names[-1])):
            time.sleep(0.1)
        buses = [ZenohBus(session, train, None, True) for train in names]
        places = [(row, unit) for unit in UNITS for row in ROWS][: max(1, round(rate_hz / trains))]
        bodies = {row: body(row, "bench") for row in ROWS}
        begun, sent, busy_s, since_s = time.monotonic(), 0, 0.0, 0.0
        for second in range(WARM_S + round(for_s)):
            if second == WARM_S:
                busy_s, since_s = sum(recorder.cpu_times()[:2]), time.monotonic()
            for row, unit in places:
                for bus in buses:
                    changed = {"sequence": second, "train": bus.train, "unit": unit}
                    bus.publish(row, unit, bodies[row].model_copy(update=changed))
                    sent += second >= WARM_S
            time.sleep(max(0.0, begun + second + 1 - time.monotonic()))
        spent_s = time.monotonic() - since_s
        time.sleep(1.0)
        return sent, spent_s, sum(recorder.cpu_times()[:2]) - busy_s


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.bench.fleet_recorder", description=__doc__)
    parser.add_argument("--trains", type=int, default=200)
    parser.add_argument("--rate", type=float, default=4400.0, help="messages a second of all trains")
    parser.add_argument("--for", type=float, default=20.0, dest="for_s", help="seconds")
    parser.add_argument("--json", action="store_true", help="print JSON")
    options = parser.parse_args()
    found = measure_fleet_recorder(options.trains, options.rate, options.for_s)
    if options.json:
        print(json.dumps(found))
        return
    lost = f"{found['missing']:.0f} of {found['sent']:.0f} missing"
    print(f"recorder of {found['trains']:.0f} trains at {found['rate_hz']:.0f} messages a second: {lost} (aim: 0)")
    print(f"its load {found['cores']:.2f} cores, {found['us_per_message']:.0f} us a message")


if __name__ == "__main__":
    main()
