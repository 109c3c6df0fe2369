"""Every decoder takes hostile bytes: it refuses them as documented, soon, and by name. `make fuzz` does so a million times."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path
from random import Random

import pytest
from hypothesis import given, note
from hypothesis import strategies as st

from .mutations import mutated
from .targets import TARGETS
from .worker import Examined

LAUGHS = "".join(f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 9)}]\n" for i in range(1, 9))
# what fuzzing and reading have found, and what is known from elsewhere
KNOWN: dict[str, tuple[str, bytes]] = {
    "a sentence without its last fields": ("nmea", b"$GNRMC,120000.00,A,5053.55035,NG,0,0000,1*32\r\n"),
    "aliases of aliases": ("yaml-train", b"train: &a0 [x, x, x]\n" + LAUGHS.encode() + b"line: *a8\n"),
    "an alias of what contains it": ("yaml-line", b"line: &x [*x]\n"),
    "a number in sixtieths that is too large": ("yaml-scenario", b"train: " + b":".join([b"59"] * 400) + b".5\n"),
    "half of a surrogate pair": ("yaml-scenario", b'train: "\\ud800"\n'),
    "half of a surrogate pair in JSON": (
        "recording",
        b'{"key": "milepost/v1/test-1/fix/balise", "payload": {"train": "\\ud800"}}\n',
    ),
    "a name that no file can have": ("yaml-scenario", b"scenario: x\ntrain: " + b"a" * 300 + b"\nduration_s: 1.0\n"),
    "a hundred thousand brackets in results": ("campaign-results", b"[" * 100_000 + b"\n"),
    "a hundred thousand brackets in GeoJSON": ("geojson", b"[" * 100_000),
    "a hundred thousand brackets in a recording": ("recording", b"[" * 100_000 + b"\n"),
    "a hundred thousand brackets in a calibration": ("calibration", b"[" * 100_000),
    "thousands of brackets": ("yaml-train", b"train: " + b"[" * 500),
    "nested lists in a message": ("message-speed_reading", b"\x91" * 2000),
    "a list that says it has four thousand million items": ("message-state", b"\xdd\xff\xff\xff\xff"),
    "frames that say they are longer than any": ("ubx", b"\xb5\x62\x01\x07\xff\xff" * 1365),
    "long frames inside each other": ("ubx", b"\xb5\x62\x01\x07\xa0\x0f" * 1365),
    "nothing but beginnings of sentences": ("nmea", b"$" * 8192),
}


@pytest.mark.parametrize("name", KNOWN)
def test_what_is_known_to_be_hostile_is_refused_soon(name: str) -> None:
    target, data = KNOWN[name]
    examined = Examined(TARGETS[target], "none", 0)
    assert TARGETS[target].decode(data)
    # tests share the processor: five times what `make fuzz` allows
    assert min(examined.timed_ms(data) for _ in range(3)) < 5.0 * TARGETS[target].slow_ms


@pytest.mark.parametrize("name", TARGETS)
def test_the_seeds_are_valid(name: str) -> None:
    """Else the mutations would begin from what is refused at once."""
    target = TARGETS[name]
    assert [target.decode(seed) for seed in target.seeds] == [()] * len(target.seeds)


@pytest.mark.parametrize("name", TARGETS)
@given(seed=st.integers(0, 2**32 - 1), data=st.binary(max_size=200))
def test_hostile_bytes_are_refused_as_documented(name: str, seed: int, data: bytes) -> None:
    target, random = TARGETS[name], Random(seed)
    for hostile in (data, mutated(random.choice(target.seeds), target.form, random)):
        note(f"{hostile!r}")
        target.decode(hostile)


def test_the_runner_counts_and_finds(tmp_path: Path) -> None:
    root = Path(__file__).parents[2]
    command = [sys.executable, "-m", "tests.fuzz", "--inputs", "300", "--target", "ubx", "--engine", "chance", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, cwd=root, timeout=60, check=True)
    (found,) = json.loads(done.stdout)["targets"]
    assert found["inputs"] == 300 == found["accepted"] + found["refused"]
    assert found["reasons"]["checksum"] > 10


def test_a_crash_a_hang_and_a_reason_are_told_apart() -> None:
    def decode(data: bytes) -> tuple[str, ...]:
        if data == b"crash":
            raise RuntimeError("no")
        while data == b"hang" and time.thread_time() < end:
            pass
        return ("short",) if len(data) < 3 else ()

    target = TARGETS["nmea"]
    examined = Examined(type(target)("mine", decode, (b"",), "text", slow_ms=5.0), "none", 4)
    for data in (b"crash", b"hang", b"", b"fine"):
        end = time.thread_time() + 1.0
        examined.take(data)
    found = examined.found
    assert (found.inputs, found.accepted, found.refused, found.crashed) == (4, 2, 1, 1)
    assert found.reasons == {"short": 1}
    assert list(found.crashes.values()) == [b"crash".hex()]
    assert list(found.slow_ms) == []  # slow once only: the machine, not the input
