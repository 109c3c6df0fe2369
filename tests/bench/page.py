"""The dispatch page with many trains: `python -m tests.bench.page` publishes their states and looks in a real browser.

The position of a state says when it was published, so that the lag is read from what stands on the page.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
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

# 1 ms is 1 m, and 0.1 ms the least digit of the first page; after a thousand seconds it begins again
PER_S, WRAP_S = 1000.0, 1000.0
STATE_HZ, MOST_PROCESSES = 50.0, 12
# what the start takes is not what a running page takes
AFTER_START_S = 20.0
# in the browser: the lag of every position that changes, and when frames came
WATCH = """() => {
  window.lags = []; window.frames = 0;
  const lag = (text) => { const at = parseFloat(text); if (!isNaN(at)) {
    let ms = (Date.now() / 1000 % %WRAP) * 1000 - at; if (ms < -500000) ms += %WRAP * 1000; window.lags.push(ms); } };
  new MutationObserver((all) => { window.frames += 1;
    for (const each of all) if (each.target.dataset?.field === "position") lag(each.target.textContent);
  }).observe(document.body, { childList: true, subtree: true });
}""".replace("%WRAP", f"{WRAP_S:g}")


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.bench.page", description=__doc__)
    parser.add_argument("--trains", type=int, default=50)
    parser.add_argument("--for", dest="for_s", type=float, default=60.0, help="seconds for each of the two pages")
    options = parser.parse_args()
    endpoint, port = f"tcp/127.0.0.1:{free_port()}", free_port()
    started = [_milepost("run", "router", "--listen", endpoint)]
    started.append(_milepost("page", "--port", str(port), "--connect", endpoint))
    over, epochs = threading.Event(), list[float]()
    sender = threading.Thread(target=_publish, args=(endpoint, options.trains, over, epochs))
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
    from playwright.sync_api import sync_playwright

    out: dict[str, Any] = {}
    with sync_playwright() as tool:
        path = shutil.which("chromium") or shutil.which("google-chrome")
        browser = tool.chromium.launch(
            executable_path=path, args=["--no-sandbox", "--disable-gpu", "--disable-quic", "--no-proxy-server"]
        )
        for name, page_path in (("overview", "/"), ("train", "/train/bench-0")):
            tab = browser.new_page()
            tab.goto(address + page_path)
            tab.wait_for_timeout(3000.0)
            tab.evaluate(WATCH)
            cores = _busy(pid, for_s, 0.0)
            lags, frames = tab.evaluate("[window.lags, window.frames]")
            p50, p99, most = np.percentile(lags, [50, 99, 100])
            out[name] = {"frames_hz": frames / for_s, "lag_ms": {"p50": p50, "p99": p99, "max": most}, "page_cores": cores}
            if page_path == "/":
                out[name]["rows"] = tab.locator("#trains tr").count()
            tab.close()
        browser.close()
    return out


def _publish(endpoint: str, trains: int, over: threading.Event, epochs: list[float]) -> None:
    """States and truths at 50 Hz and a health of each process a second, of each train in turn."""
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
            epoch, due = epoch + 1, due + 1.0 / STATE_HZ
            epochs.append(time.monotonic())
            for name, told, true, tells in zip(names, states, truths, healths, strict=True):
                now_ns = time.time_ns()
                stamps = {"train": name, "measured_at_ns": now_ns, "published_at_ns": now_ns}
                at_m = now_ns * 1e-9 % WRAP_S * PER_S
                place = {"position_m": at_m, "position_min_m": at_m - 2.0, "position_max_m": at_m + 2.0}
                told.put(_packed({**state, **stamps, **place, "epoch": epoch}))
                true.put(_packed({**truth, **stamps, "position_m": at_m}))
                if epoch % round(STATE_HZ) == 0:
                    for _ in range(MOST_PROCESSES):
                        tells.put(_packed({**health, **stamps}))


def _packed(fields: dict[str, Any]) -> bytes:
    import msgpack

    return msgpack.packb(fields)


if __name__ == "__main__":
    main()
