"""`milepost inject` against running trains: readings change, come back, and only where the train file allows it."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from conftest import Outside, Stack, running, start

READING = "milepost/v1/maglev-1/reading/radar"
EVENT = "milepost/v1/maglev-1/event"
STATE = "milepost/v1/maglev-1/state"


def inject(endpoint: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "milepost", "inject", "--connect", endpoint, *arguments]
    return subprocess.run(command, capture_output=True, text=True, timeout=30, check=False)


@pytest.fixture(scope="module")
def chaotic(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Stack, Outside]]:
    """The maglev train with `chaos: true`."""
    deployed = Path("deploy/trains/maglev.yaml").resolve()
    fields = yaml.safe_load(deployed.read_text(encoding="utf-8"))
    fields |= {"chaos": True, "line": str((deployed.parent / fields["line"]).resolve())}
    path = tmp_path_factory.mktemp("chaotic") / "maglev.yaml"
    path.write_text(yaml.safe_dump(fields), encoding="utf-8")
    stack, outside = start(str(path))
    try:
        outside.wait_state(STATE, lambda m: m["status"] == "normal", 40.0, "a normal state")
        yield stack, outside
    finally:
        outside.close()
        code = stack.stop()
    assert code == 0, "".join(stack.errors)


def test_readings_change_and_come_back(chaotic):
    """GIVEN a radar, WHEN it gets a bias of 50 σ for 1.5 s, THEN its readings have it for so long, and none after."""
    stack, outside = chaotic
    done = inject(stack.endpoint, "radar", "bias", "--size", "10", "--for", "1.5", "--json")
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    assert (answer["train"], answer["unit"], answer["kind"], answer["done"]) == ("maglev-1", "radar", "bias", True)

    def over():
        heard = [m for _, m in outside.heard[READING]]
        lies = [m["measured_at_ns"] for m in heard if m["speed_mps"] > 25.0]
        return lies if lies and heard[-1]["measured_at_ns"] > lies[0] + 2_500_000_000 else None

    lies = outside.wait_for(over, 10.0, "the end of the bias")
    assert 1.4 < (lies[-1] - lies[0]) * 1e-9 < 1.5
    assert len(lies) == pytest.approx(150, abs=3)
    (event,) = [e for e in outside.messages(EVENT) if e["code"] == "fault_injected"]
    assert event["unit"] == "radar"
    assert "bias (size 10) for 1.5 s" in event["text"]


def test_clear_ends_a_fault_without_an_end(chaotic):
    stack, outside = chaotic
    assert inject(stack.endpoint, "radar", "stuck").returncode == 0

    def stuck():
        newest = [m["speed_mps"] for _, m in outside.heard[READING][-10:]]
        return len(set(newest)) == 1

    outside.wait_for(stuck, 5.0, "ten readings alike")
    done = inject(stack.endpoint, "radar", "--clear")
    assert (done.returncode, done.stdout.strip()) == (0, "milepost: maglev-1: radar: injected faults ended: stuck")
    outside.wait_for(lambda: not stuck(), 5.0, "readings that differ")


def test_a_misfit_and_a_missing_unit_are_refused(chaotic):
    stack, _ = chaotic
    done = inject(stack.endpoint, "radar", "jump", "--size", "5")
    assert done.returncode == 2
    assert done.stderr == "milepost: maglev-1: radar: jump does not fit speed_reading, but position_reading\n"
    done = inject(stack.endpoint, "rader", "bias", "--size", "5")
    assert done.returncode == 2
    assert "inject: UNIT: must be one of balise-reader, fuser, loop, radar, not 'rader'; did you mean 'radar'?" in done.stderr
    cleared = inject(stack.endpoint, "rader", "--clear")
    assert (cleared.returncode, cleared.stderr) == (2, done.stderr)
    done = inject(stack.endpoint, "balise-reader", "missed_balise", "--balise", "zzz")
    assert done.returncode == 2
    assert done.stderr.startswith("milepost: maglev-1: balise-reader: balise: zzz is not among the ")
    done = inject(stack.endpoint, "radar", "stuck", "--train", "maglev-2")
    assert done.returncode == 2
    assert "inject: --train: must be one of maglev-1, not 'maglev-2'" in done.stderr


def test_a_command_that_is_no_fault_is_refused(chaotic):
    _, outside = chaotic
    outside.session.put("milepost/v1/maglev-1/@chaos/radar", b"\xc1garbage")

    def refused():
        return any(e["code"] == "refused_undecodable" and e["unit"] == "radar" for _, e in outside.heard[EVENT])

    outside.wait_for(refused, 5.0, "an event of the refusal")


NOT_ALLOWED = "milepost: inject: maglev-1 allows no injection of faults: its train file does not say `chaos: true`\n"


def test_a_train_without_chaos_refuses_beside_a_recorder_too(tmp_path):
    """The recorder, which hears every other stream, is nobody who would take a fault."""
    with running("maglev", "milepost/v1/maglev-1/state", "--record", str(tmp_path)) as (stack, _):
        done = inject(stack.endpoint, "radar", "bias", "--size", "10")
    assert (done.returncode, done.stdout, done.stderr) == (2, "", NOT_ALLOWED)


def test_a_train_without_chaos_refuses(maglev):
    stack, outside = maglev
    done = inject(stack.endpoint, "radar", "bias", "--size", "10")
    assert (done.returncode, done.stdout, done.stderr) == (2, "", NOT_ALLOWED)
    before = len(outside.messages(READING))
    outside.wait_for(lambda: len(outside.heard[READING]) > before + 50, 5.0, "fifty readings")
    assert all(m["speed_mps"] < 25.0 for m in outside.messages(READING))


def test_a_router_that_takes_no_session_is_told_from_one_that_is_not_there(router):
    """WHEN somebody listens and does not speak Zenoh with this client, THEN the line says so, and not to start a router."""
    done = inject(router.replace("tcp/", "tls/"), "radar", "stuck")
    assert done.returncode == 1
    assert "somebody listens there, and takes no session: a secure train needs `--zenoh-config`" in done.stderr
    assert "start one" not in done.stderr


def test_without_a_train_or_a_router_it_says_so(router):
    done = inject(router, "radar", "stuck")
    assert (done.returncode, done.stderr) == (1, f"milepost: no train is running at {router}\n")
    done = inject("tcp/127.0.0.1:9", "radar", "stuck")
    assert done.returncode == 1
    assert done.stderr.startswith("milepost: no router at tcp/127.0.0.1:9")
