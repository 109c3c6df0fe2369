"""Runs all measurements and prints them with their aims."""

from __future__ import annotations

import argparse
import json
import os
import platform
import sys

import numpy as np

from .bank import measure_bank
from .fleet import measure_fleet
from .fleet import text as fleet_text
from .live import (
    WINDOW_S,
    measure_fast_load,
    measure_full_load,
    measure_raw,
    measure_security,
    measure_startup,
    measure_train,
)
from .recorder import AIM_HZ, measure_recorder
from .steps import OFFLINE, measure_nodes, measure_offline, measure_steps

STARTS = 5
RECORD_S = 20.0
# a fleet of the shipped kind, recorded: 200 trains for ten minutes take `python -m tests.bench.fleet`
FLEET_TRAINS, FLEET_HZ, FLEET_S, FLEET_START_S = 30, 1.0, 20.0, 60.0


def say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.bench", description=__doc__)
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("--pairs", type=int, default=5, help="interleaved pairs of train and raw chain (0: none)")
    parser.add_argument("--offline-only", action="store_true", help="only what needs no router")
    options = parser.parse_args()
    say("steps ...")
    found: dict = {"steps_us": measure_steps(), "nodes_us": measure_nodes()}
    found["fuser_step"] = {name: measure_bank(path) for name, path in OFFLINE.items()}
    say("offline speed ...")
    found["offline_x_real_time"] = {name: measure_offline(path) for name, path in OFFLINE.items()}
    pairs = []
    for number in range(0 if options.offline_only else options.pairs):
        say(f"live latency, pair {number + 1} of {options.pairs} ...")
        train, load = measure_train(WINDOW_S)
        pairs.append({"train": train, "raw": measure_raw(WINDOW_S), "load_cores": load})
    if options.pairs and not options.offline_only:
        say("cost of security ...")
        found["security"] = {"pairs": options.pairs, **measure_security(options.pairs), "load_average": os.getloadavg()[0]}
    if pairs:
        found["live"] = {
            "pairs": pairs,
            "train_p50_ms": float(np.median([p["train"]["p50_ms"] for p in pairs])),
            "train_p99_ms": float(np.median([p["train"]["p99_ms"] for p in pairs])),
            "raw_p50_ms": float(np.median([p["raw"]["p50_ms"] for p in pairs])),
            "raw_p99_ms": float(np.median([p["raw"]["p99_ms"] for p in pairs])),
            "p50_over_raw": float(np.median([p["train"]["p50_ms"] / p["raw"]["p50_ms"] for p in pairs])),
            "load_cores": float(np.median([p["load_cores"] for p in pairs])),
            "full": measure_full_load(),
            "fast": measure_fast_load(),
            "startup": measure_startup(STARTS),
            "recorder": measure_recorder(AIM_HZ, RECORD_S),
            "fleet": measure_fleet(FLEET_TRAINS, FLEET_HZ, FLEET_S, "together", True, False, FLEET_START_S),
        }
    if options.json:
        print(json.dumps(found, indent=2))
        return
    table(found)


def table(found: dict) -> None:
    steps = found["steps_us"]
    ours = steps["filter step (scalar kernel)"]
    print(f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}\n")
    for name, value in {**steps, **found["nodes_us"]}.items():
        peer = f"  {value / ours:6.1f} x ours" if "filterpy" in name or "Stone" in name else ""
        print(f"{name:58}{value:9.2f} µs{peer}")
    ratio = steps["filterpy step"] / ours
    print(f"\nfilter step against filterpy          {ratio:8.1f} x faster       (aim 10)")
    for name, step in found["fuser_step"].items():
        what = f"fuser, {name}: bank of {step['hypotheses']} hypotheses / one belief"
        costs = f"({step['bank_us']:.0f} / {step['one_belief_us']:.0f} µs; numpy's calls alone {step['bare_us']:.0f} µs)"
        print(f"{what:53} {step['bank_over_one']:8.2f} x {costs}    (at most 3)")
    for name, speed in found["offline_x_real_time"].items():
        target = "    (at least 15)" if name == "full" else ""
        print(f"offline, {name:8} train              {speed:8.1f} x real time{target}")
    if "security" in found:
        table_of_security(found["security"])
    live = found.get("live")
    if live is None:
        return
    print(f"live latency p50 / p99                {live['train_p50_ms']:8.2f} / {live['train_p99_ms']:.2f} ms")
    print(f"raw chain, same hops, p50 / p99       {live['raw_p50_ms']:8.2f} / {live['raw_p99_ms']:.2f} ms")
    print(f"p50 over raw, median of {len(live['pairs'])} pairs       {live['p50_over_raw']:8.2f}               (at most 2)")
    print(f"maglev, all processes with router     {live['load_cores']:8.2f} cores         (at most 0.6, aim 0.4)")
    for name, what, aim in (("full", "as shipped", "at most 0.8"), ("fast", "at 100 Hz", "at most 1.0, aim 0.8")):
        load = live[name]
        missing = f"{load['missing_epochs']:.0f} epochs missing"
        print(f"full train {what:10} with two fusers  {load['load_cores']:8.2f} cores, {missing} ({aim})")
    startup = live["startup"]
    print(f"first state after `milepost up`       {startup['first_state_s']:8.2f} s             (at most 4)")
    print(f"memory of all its processes (PSS)     {startup['memory_pss_mib']:8.0f} MiB           (at most 600, aim 450)")
    recorder = live["recorder"]
    lost = f"{recorder['missing']:.0f} of {recorder['sent']:.0f} messages missing"
    print(f"recorder at {AIM_HZ:.0f} messages a second       {recorder['cores']:8.2f} cores, {lost} (aim 0)")
    print(fleet_text(live["fleet"]).replace("; ", "\n  "))


def table_of_security(costs: dict) -> None:
    print(f"what certificates cost, maglev, medians of {costs['pairs']} pairs, load average {costs['load_average']:.1f}:")
    for figure, unit in (("p50_ms", "ms"), ("p99_ms", "ms"), ("cores", "cores")):
        print(f"  {figure.removesuffix('_ms'):36}{costs[f'open_{figure}']:8.2f} -> {costs[f'secure_{figure}']:.2f} {unit}")


main()
