"""What a fleet costs, and what is lost of it: `python -m tests.bench.fleet --trains 10 50 --for 60 --out fleet.json`."""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import yaml
import zenoh

from milepost.chaos.running import free_port, title_of
from milepost.cli.proc import proportional_mib
from milepost.config.shipped_files import find_file
from milepost.recorder.reading import recordings_in
from milepost.recorder.summary import Summary
from milepost.runtime.zenoh_config import client

from .browser import browsing, seen, watched
from .outside import Outside

FLEET = "two-hundred"
# trains in shared processes; one process for each train; ten processes for each train
MODES = ("together", "one-each", "apart")
SETTLE_S = 8.0


def fleet_file(folder: Path, trains: int, hz: float, mode: str) -> Path:
    """The shipped fleet with another number of trains and other rates."""
    source = find_file(Path(FLEET), "fleets")
    fleet = yaml.safe_load(source.read_text(encoding="utf-8"))
    (entry,) = fleet["trains"]
    entry["count"] = trains
    entry["change"]["fusion"] = {"period_ms": round(1000 / hz), "deadline_ms": 600.0 / hz}
    for unit in entry["change"]["units"].values():
        unit["rate_hz"] = hz
    if mode == "one-each":  # trains that do not start at the same time do not share a process
        name = entry.pop("name")
        del entry["count"]
        fleet["trains"] = [
            {
                **entry,
                "name": f"{name}-{n + 1}",
                "start_after_s": n * 1e-3,
                "change": {**entry["change"], "world": {"seed": n + 1}},
            }
            for n in range(trains)
        ]
    path = folder / "fleet.yaml"
    path.write_text(yaml.safe_dump(fleet), encoding="utf-8")
    return path


@contextmanager
def running(
    fleet: Path, endpoint: str, mode: str, record: Path | None, page: int | None, log: Path
) -> Iterator[subprocess.Popen]:
    words = ["up", "--headless", "--fleet", str(fleet), "--listen", endpoint]
    words += ["--together"] if mode != "apart" else []
    words += ["--record", str(record)] if record is not None else []
    words += ["--page", str(page)] if page is not None else []
    with log.open("wb") as errors:
        up = subprocess.Popen([sys.executable, "-m", "milepost", *words], stderr=errors, stdout=errors)
        try:
            yield up
        finally:
            up.send_signal(signal.SIGINT)
            up.wait(60.0)


def kinds(pid: int) -> dict[str, list[int]]:
    """The processes of `up` by what they are: `together`, `recorder`, `router`, `page`, others."""
    found: dict[str, list[int]] = {"up": [pid]}
    for child in psutil.Process(pid).children(recursive=True):
        words = title_of(child.pid).split()
        found.setdefault(words[2] if words[1:2] == ["run"] else "page" if "page" in words[1:2] else "display", []).append(
            child.pid
        )
    return found


def busy_s(pids: Sequence[int]) -> float:
    return sum(sum(psutil.Process(pid).cpu_times()[:2]) for pid in pids)


@contextmanager
def looked_at(port: int | None) -> Iterator[Any]:
    """A browser's tab that shows the dispatch page of a port; None without a port."""
    if port is None:
        yield None
        return
    with browsing() as browser:
        yield watched(browser, f"http://127.0.0.1:{port}")


def measure_fleet(trains: int, hz: float, for_s: float, mode: str, record: bool, page: bool, start_s: float) -> dict[str, Any]:
    """All figures of one fleet. What it recorded is counted, and deleted."""
    with tempfile.TemporaryDirectory(prefix="milepost-bench-") as name:
        folder, endpoint = Path(name), f"tcp/127.0.0.1:{free_port()}"
        recording, port = folder / "recording" if record else None, free_port() if page else None
        fleet, outside = fleet_file(folder, trains, hz, mode), Outside()
        begun = time.monotonic()
        with (
            running(fleet, endpoint, mode, recording, port, folder / "log") as up,
            zenoh.open(zenoh.Config.from_json5(json.dumps(client([endpoint])))) as session,
        ):
            kept = session.declare_subscriber("milepost/v1/*/state", outside.receive)
            while len(outside.first_s) < trains and time.monotonic() < begun + start_s and up.poll() is None:
                time.sleep(0.2)
            time.sleep(SETTLE_S)
            with looked_at(port) as tab:
                before, idle = {kind: busy_s(pids) for kind, pids in kinds(up.pid).items()}, psutil.cpu_times()
                outside.listening, since = True, time.monotonic()
                time.sleep(for_s)
                outside.listening, spent_s = False, time.monotonic() - since
                after, machine = kinds(up.pid), psutil.cpu_times()
                shown = {} if tab is None else on_page(tab, outside)
            cores = {kind: (busy_s(pids) - before.get(kind, 0.0)) / spent_s for kind, pids in after.items()}
            memory = {kind: proportional_mib(pids) for kind, pids in after.items()}
            del kept
        first = sorted(at - begun for at in outside.first_s.values())
        total, mib = sum(cores.values()), sum(memory.values())
        busy = 1.0 - (machine.idle - idle.idle) / (spent_s * (os.cpu_count() or 1))
        return {
            "trains": trains,
            "hz": hz,
            "mode": mode,
            "for_s": spent_s,
            "first_state_s": first[0] if first else None,
            "all_states_s": first[-1] if len(first) == trains else None,
            **outside.figures(trains, hz, spent_s),
            "cores": cores,
            "cores_total": total,
            "ms_per_train_s": 1e3 * total / trains,
            "memory_pss_mib": memory,
            "memory_total_mib": mib,
            "mib_per_train": mib / trains,
            "machine_busy": busy,
            **shown,
            **({} if recording is None else recorded(recording)),
            "restarts": (folder / "log").read_text(errors="replace").count(" restarted"),
        }


def on_page(tab: Any, outside: Outside) -> dict[str, Any]:
    """What a browser showed of the fleet, and how much later than the subscriber had it."""
    lags = outside.lags_ms(seen(tab)[0])
    p50, p99, most = np.percentile(lags, [50, 99, 100]) if lags else [float("nan")] * 3
    rows = tab.locator("#trains tr").count()
    return {"page_rows": rows, "page_positions": len(lags), "page_lag_ms": {"p50": p50, "p99": p99, "max": most}}


def recorded(folder: Path) -> dict[str, Any]:
    """What the recorder wrote, and what is missing of each stream between the first and the last message of each sender."""
    messages = size = 0
    missing: Counter[str] = Counter()
    for path in recordings_in(folder):  # one after the other: all at once would be more senders than are followed
        found = Summary().read([path])
        messages += sum(tally.messages for tally in found.streams.values())
        for sender, run in found.senders.items():
            missing[sender.stream] += run.missing
        size += path.stat().st_size
    lost = {stream: number for stream, number in sorted(missing.items()) if number}
    counts = {"recorder_missing": missing.total(), "recorder_missing_of": lost}
    return {"recorded": messages, **counts, "recorded_mib": size / 2**20}


def text(found: dict[str, Any]) -> str:
    cores = ", ".join(f"{kind} {value:.2f}" for kind, value in sorted(found["cores"].items(), key=lambda each: -each[1]))
    start = found["all_states_s"]
    said = [
        f"{found['trains']} trains at {found['hz']:g} Hz, {found['mode']}: {found['cores_total']:.2f} cores ({cores})",
        f"{found['ms_per_train_s']:.1f} ms a train and second",
        f"{found['memory_total_mib']:.0f} MiB, {found['mib_per_train']:.1f} a train",
        f"{found['states_per_s']:.0f} of {found['expected_per_s']:.0f} states/s outside",
        f"{found['epochs_missing']} epochs missing",
        f"{found['states_awaiting']} states awaiting, age {found['age_p50_ms']:.0f} ms, 99 % {found['age_p99_ms']:.0f} ms",
        f"all trains speak after {'never' if start is None else f'{start:.1f} s'}",
        f"machine {found['machine_busy']:.0%} busy",
    ]
    if "page_lag_ms" in found:
        lag = found["page_lag_ms"]
        said.append(f"{found['page_rows']} rows on the page, {lag['p50']:.0f} ms later, 99 % {lag['p99']:.0f} ms")
    if "recorded" in found:
        of = ", ".join(f"{number} {stream}" for stream, number in found["recorder_missing_of"].items())
        missing = f"{found['recorder_missing']} of {found['recorded']} messages missing in the recording"
        said.append(f"{missing} ({of})" if of else missing)
    return "; ".join(said)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.bench.fleet", description=__doc__)
    parser.add_argument("--trains", type=int, nargs="+", default=[10, 50, 100, 200])
    parser.add_argument(
        "--hz", type=float, nargs="+", default=[10.0], help="states a second, and readings of each speed sensor"
    )
    parser.add_argument("--mode", nargs="+", choices=MODES, default=["together"])
    parser.add_argument("--for", type=float, default=60.0, dest="for_s", help="seconds")
    parser.add_argument("--no-record", action="store_true", help="without a recorder")
    parser.add_argument("--page", action="store_true", help="with the dispatch page, shown by a browser")
    parser.add_argument("--start", type=float, default=180.0, help="seconds to wait for all trains")
    parser.add_argument("--out", type=Path, help="write JSON to this file, after each fleet")
    options = parser.parse_args()
    found = []
    for mode in options.mode:
        for hz in options.hz:
            for trains in options.trains:
                each = measure_fleet(trains, hz, options.for_s, mode, not options.no_record, options.page, options.start)
                print(text(each), flush=True)
                found.append(each)
                if options.out is not None:
                    options.out.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
