"""The dispatch page with many trains: `python -m tests.bench.page` publishes their states and looks in a real browser.

The position of a state says when it was published, so that the lag is read from what stands on the page.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import threading
import time
from typing import Any

import numpy as np
import psutil

from milepost.chaos.running import free_port
from milepost.runtime import zenoh_config
from milepost.runtime.bus import open_session
from milepost_schemas import BY_NAME, Health

from .browser import browsing, seen, watched

# 1 ms is 1 m, and 0.1 ms the least digit of the first page; after a thousand seconds it begins again
PER_S, WRAP_S = 1000.0, 1000.0
MOST_PROCESSES = 12
# what the start takes is not what a running page takes
AFTER_START_S = 20.0


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.bench.page", description=__doc__)
    parser.add_argument("--trains", type=int, default=50)
    parser.add_argument("--hz", type=float, default=50.0, help="states a second of each train")
    parser.add_argument("--for", dest="for_s", type=float, default=60.0, help="seconds for each of the two pages")
    options = parser.parse_args()
    endpoint, port = f"tcp/127.0.0.1:{free_port()}", free_port()
    started = [_milepost("run", "router", "--listen", endpoint)]
    started.append(_milepost("page", "--port", str(port), "--connect", endpoint))
    over, epochs = threading.Event(), list[float]()
    sender = threading.Thread(target=_publish, args=(endpoint, options.trains, options.hz, over, epochs))
    sender.start()
    try:
        found = {
            "trains": options.trains,
            "cores_unwatched": _busy(started[1].pid, options.for_s / 4, AFTER_START_S),
            **_look(f"http://127.0.0.1:{port}", started[1].pid, options.for_s),
            "page_mib": psutil.Process(started[1].pid).memory_info().rss / 2**20,
            "load_average": os.getloadavg()[0],
        }
    finally:
        over.set()
        sender.join()
        for process in reversed(started):
            process.send_signal(signal.SIGTERM)
            process.wait(10.0)
    found["states_hz"] = options.trains * len(epochs) / (epochs[-1] - epochs[0])
    print(json.dumps(found, indent=1))


def _milepost(*words: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen([sys.executable, "-m", "milepost", *words], stderr=subprocess.DEVNULL)


def _busy(pid: int, for_s: float, after_s: float) -> float:
    """The processor that a process takes, in cores."""
    time.sleep(after_s)
    process = psutil.Process(pid)
    before = sum(process.cpu_times()[:2])
    time.sleep(for_s)
    return (sum(process.cpu_times()[:2]) - before) / for_s


def _look(address: str, pid: int, for_s: float) -> dict[str, Any]:
    out: dict[str, Any] = {}
    with browsing() as browser:
        for name, page_path in (("overview", "/"), ("train", "/train/bench-0")):
            tab = watched(browser, address + page_path)
            cores = _busy(pid, for_s, 0.0)
            shown, frames = seen(tab)
            p50, p99, most = np.percentile(
                [_lag_ms(text, at_ms) for _, text, at_ms in shown if text[:1].isdigit()], [50, 99, 100]
            )
            out[name] = {"frames_hz": frames / for_s, "lag_ms": {"p50": p50, "p99": p99, "max": most}, "page_cores": cores}
            if page_path == "/":
                out[name]["rows"] = tab.locator("#trains tr").count()
            tab.close()
    return out


def _lag_ms(text: str, at_ms: float) -> float:
    """How long ago the state that stands there was published."""
    return (at_ms - float(text) + WRAP_S * 500.0) % (WRAP_S * 1000.0) - WRAP_S * 500.0


def _publish(endpoint: str, trains: int, hz: float, over: threading.Event, epochs: list[float]) -> None:
    """States and truths at `hz` and a health of each process a second, of each train in turn."""
    # what does not change of a state is packed once
    sys.path.insert(0, "tests")
    from examples import EXAMPLES, head

    state = {**EXAMPLES["state"][0].model_dump(), **head("fuser"), "settled": False, "reset": None, "awaiting": []}
    truth = {**EXAMPLES["truth"][0].model_dump(), **head("world")}
    health = Health.model_validate({**EXAMPLES["health"][0].model_dump(), **head("filter-radar")}).model_dump()
    with open_session(zenoh_config.client([endpoint])) as session:
        names = [f"bench-{i}" for i in range(trains)]
        states, truths = (
            [session.declare_publisher(BY_NAME[each].key_for(name)) for name in names] for each in ("state", "truth")
        )
        healths = [session.declare_publisher(BY_NAME["health"].key_for(name, "filter-radar")) for name in names]
        epoch, due = 0, time.monotonic()
        while not over.wait(max(due - time.monotonic(), 0.0)):
            epoch, due = epoch + 1, due + 1.0 / hz
            epochs.append(time.monotonic())
            for name, told, true, tells in zip(names, states, truths, healths, strict=True):
                now_ns = time.time_ns()
                stamps = {"train": name, "measured_at_ns": now_ns, "published_at_ns": now_ns}
                at_m = now_ns * 1e-9 % WRAP_S * PER_S
                place = {"position_m": at_m, "position_min_m": at_m - 2.0, "position_max_m": at_m + 2.0}
                told.put(_packed({**state, **stamps, **place, "epoch": epoch}))
                true.put(_packed({**truth, **stamps, "position_m": at_m}))
                if epoch % round(hz) == 0:
                    for _ in range(MOST_PROCESSES):
                        tells.put(_packed({**health, **stamps}))


def _packed(fields: dict[str, Any]) -> bytes:
    import msgpack

    return msgpack.packb(fields)


if __name__ == "__main__":
    main()
