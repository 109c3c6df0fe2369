"""A stranger floods one key of a train with 20 000 messages a second: `state` keeps its rate, and misses no epoch."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from conftest import Outside, Stack
from lighter import PERIOD_MS, lighter

pytestmark = pytest.mark.long

TOP = "milepost/v1/full-1"
STATE = f"{TOP}/state"
RATE_HZ, FLOODED_S = 20_000, 5.0


@pytest.fixture(scope="module")
def full(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Stack, Outside]]:
    """The full train with less work; who looks at it does not hear the flood."""
    stack = Stack(str(lighter("full", tmp_path_factory.mktemp("train"))))
    outside = Outside(stack.endpoint)
    for key in ("state", "event", "health/*"):
        outside.listen(f"{TOP}/{key}")
    try:
        outside.wait_state(STATE, lambda m: m["status"] == "normal", 40.0, "a normal state")
        yield stack, outside
    finally:
        outside.close()
        assert stack.stop() == 0


@pytest.mark.parametrize(
    ("key", "kind", "refusing", "reason"),
    [
        ("reading/radar-front", "random", "filter-radar-front", "undecodable"),
        ("reading/radar-front", "map", "filter-radar-front", "invalid"),
        ("reading/radar-front", "replay", "filter-radar-front", "duplicate"),
        ("estimate/radar-front", "replay", "fuser", "duplicate"),
    ],
)
def test_a_flood_of_one_key_takes_no_state(full, key: str, kind: str, refusing: str, reason: str) -> None:
    stack, outside = full
    outside.wait_state(STATE, lambda m: m["status"] == "normal", 20.0, "a normal state")
    health = f"{TOP}/health/{refusing}"
    refused_before = outside.there(health)["refused"].get(reason, 0)
    begun = len(outside.heard[STATE])
    command = [sys.executable, str(Path(__file__).with_name("flood.py")), stack.endpoint, f"{TOP}/{key}", str(RATE_HZ)]
    done = subprocess.run([*command, str(FLOODED_S), kind], capture_output=True, text=True, timeout=60, check=True)
    count, spent_s = map(float, done.stdout.split())
    assert count / spent_s > 0.9 * RATE_HZ
    seen = outside.messages(STATE)[begun:]
    # where the machine stalls, both fusers may say an epoch
    epochs = {state["epoch"] for state in seen}
    assert epochs == set(range(min(epochs), max(epochs) + 1)), "an epoch is missing"
    assert len(epochs) >= 0.95 * FLOODED_S * 1000.0 / PERIOD_MS
    assert {state["status"] for state in seen} <= {"normal", "degraded"}
    assert {each["unit"] for state in seen for each in state["excluded"]} <= {"radar-front"}, "a unit that is not flooded"

    def refused() -> bool:
        counts = outside.newest(health)["refused"]
        return counts.get(reason, 0) - refused_before + counts.get("overflow", 0) > 0.9 * count

    outside.wait_for(refused, 5.0, f"all that was put, counted as {reason}")


def test_the_router_drops_what_is_larger_than_its_stream_allows(full) -> None:
    _, outside = full
    health = f"{TOP}/health/filter-loop"
    begun = outside.there(health)["sequence"]
    for _ in range(100):
        outside.session.put(f"{TOP}/reading/loop", b"\xc1" * 5000)
    outside.session.put(f"{TOP}/reading/loop", b"\xc1" * 4000)
    outside.wait_for(lambda: outside.newest(health)["sequence"] > begun + 2, 10.0, "two healths")
    assert outside.newest(health)["refused"].get("undecodable") == 1
