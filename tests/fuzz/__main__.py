"""Feeds every decoder with hostile bytes and counts what comes of it; exit code 1 where one crashes, hangs or grows."""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from .targets import TARGETS, Target

# libFuzzer keeps what it found in memory
LARGEST_GROWTH_MIB = 32.0
# how many reasons the table names for each decoder; --json has all
SHOWN = 8


def say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


def shares(names: list[str], inputs: int) -> dict[str, int]:
    """How many inputs each target gets."""
    total = sum(TARGETS[name].share for name in names)
    counts = {name: round(inputs * TARGETS[name].share / total) for name in names}
    counts[names[0]] += inputs - sum(counts.values())
    return counts


def examine(name: str, engine: str, inputs: int, seed: int, folder: Path) -> dict[str, Any]:
    """One target, in a process of its own."""
    out = folder / f"{name}.json"
    command = [sys.executable, "-m", "tests.fuzz.worker", name, engine, str(inputs), str(seed), str(out)]
    process = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, check=False)
    if not out.is_file():
        return {
            "target": name,
            "engine": engine,
            "inputs": 0,
            "died": f"exit code {process.returncode}: {process.stderr[-500:]}",
        }
    found: dict[str, Any] = json.loads(out.read_text(encoding="utf-8"))
    # libFuzzer's counters make the code slower: what was slow under them is timed without
    target = TARGETS[name]
    found["slow_ms"] = {data: ms for data in found["slow_ms"] if (ms := timed_ms(target, bytes.fromhex(data))) > target.slow_ms}
    return found


def timed_ms(target: Target, data: bytes) -> float:
    from .worker import Examined

    examined = Examined(target, "none", 0)
    return min(examined.timed_ms(data) for _ in range(3))


def defects(found: dict[str, Any]) -> list[str]:
    """What is wrong with a target, in sentences."""
    if "died" in found:
        return [f"{found['target']}: the process died: {found['died']}"]
    out = [f"{found['target']}: {text}: {data[:2000]}" for text, data in found["crashes"].items()]
    out += [f"{found['target']}: {ms:.0f} ms: {data[:2000]}" for data, ms in found["slow_ms"].items()]
    if found["growth_mib"] > LARGEST_GROWTH_MIB:
        out.append(f"{found['target']}: grew by {found['growth_mib']:.0f} MiB over the second half of its inputs")
    return out


def table(results: list[dict[str, Any]]) -> None:
    print(
        f"{'decoder':26}{'inputs':>9}{'accepted':>10}{'refused':>9}{'reasons':>9}{'crashes':>9}{'slow':>6}{'growth':>11}{'time':>9}"
    )
    for found in results:
        if "died" in found:
            print(f"{found['target']:26}died")
            continue
        reasons = sorted(found["reasons"].items(), key=lambda pair: -pair[1])
        print(
            f"{found['target']:26}{found['inputs']:9}{found['accepted']:10}{found['refused']:9}{len(reasons):9}{found['crashed']:9}"
            f"{len(found['slow_ms']):6}{found['growth_mib']:7.1f} MiB{found['seconds']:7.0f} s"
        )
        for reason, count in reasons[:SHOWN]:
            print(f"{'':26}{count:9} {reason}")


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--inputs", type=int, default=1_000_000, help="how many inputs in all (default: 1000000)")
    parser.add_argument("--target", action="append", choices=sorted(TARGETS), help="only this decoder; may be repeated")
    parser.add_argument("--engine", choices=("atheris", "chance"), help="default: atheris where it is installed")
    parser.add_argument("--seed", type=int, default=1, help="inputs follow from it (default: 1)")
    parser.add_argument("--json", action="store_true", help="print JSON")
    options = parser.parse_args()
    engine = options.engine or ("atheris" if find_spec("atheris") else "chance")
    names = options.target or list(TARGETS)
    results = []
    with tempfile.TemporaryDirectory(prefix="milepost-fuzz-") as folder:
        for name, count in shares(names, options.inputs).items():
            say(f"{name}: {count} inputs by {engine} ...")
            results.append(examine(name, engine, count, options.seed, Path(folder)))
    found = [sentence for each in results for sentence in defects(each)]
    if options.json:
        print(json.dumps({"targets": results, "defects": found}, indent=2))
    else:
        table(results)
    for sentence in found:
        say(sentence)
    sys.stdout.flush()
    sys.exit(int(bool(found)))


main()
