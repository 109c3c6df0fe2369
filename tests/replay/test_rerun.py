"""`milepost rerun`: what was recorded gives the same settled states again, from readings or estimates, in any order."""

from __future__ import annotations

import json
import random
import subprocess
import sys
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from milepost.config.scenario_file import load_scenario
from milepost.evaluation.run_log import RunLog
from milepost.offline.run import simulate
from milepost.recorder.file import RecordingFile
from milepost.recorder.incoming import Incoming, head_of
from milepost.recorder.scenario_clock import simulation_facts
from milepost_schemas import STREAMS, Refused, Stream, encode, from_fields

ROOT = Path(__file__).resolve().parents[2]
pytestmark = pytest.mark.slow
TRAIN = ROOT / "deploy/trains/maglev.yaml"
DURATION_S = 7.0
SEED = 7
Line = dict[str, Any]


def milepost(*arguments: object, program: tuple[str, ...] = ("-m", "milepost")) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, *program, *map(str, arguments)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120, check=False)


def rerun(lines: list[Line] | Path, out: Path, origin: str) -> bytes:
    """The states that a recording settles to."""
    if isinstance(lines, Path):
        recording = lines
    else:
        recording = out.with_suffix(".in.jsonl")
        recording.write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8")
    done = milepost("rerun", recording, "--train", TRAIN, "--out", out, "--from", origin)
    assert done.returncode == 0, done.stderr
    return out.read_bytes()


@dataclass(frozen=True)
class Recorded:
    """A recording of the CLI's, and what the run settled to."""

    path: Path
    settled: bytes

    @property
    def lines(self) -> list[Line]:
        return [json.loads(line) for line in self.path.read_text(encoding="utf-8").splitlines()]


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Recorded:
    """Seven seconds, with one balise, of the train file as it is: a rerun knows the train, not the scenario."""
    folder = tmp_path_factory.mktemp("recorded")
    scenario, path = folder / "scenario.yaml", folder / "messages.jsonl"
    scenario.write_text(f"scenario: short\ntrain: {TRAIN}\nduration_s: {DURATION_S}\nseed: {SEED}\n", encoding="utf-8")
    done = milepost("evaluate", scenario, "--record", path)
    assert done.returncode == 0, done.stderr
    log = RunLog(load_scenario(scenario)[1])
    simulate(log.train, DURATION_S, None, log.keep)
    return Recorded(path, "".join(state.model_dump_json() + "\n" for state in log.settled.values()).encode())


@pytest.fixture(scope="module")
def shuffled(recorded: Recorded) -> list[Line]:
    """The same messages up to two seconds late, so out of order, and one in twenty twice."""
    rng = random.Random(11)
    lines = []
    for line in recorded.lines:
        for _ in range(2 if rng.random() < 0.05 else 1):
            lines.append({**line, "received_at_ns": line["received_at_ns"] + int(rng.random() * 2e9)})
    lines.sort(key=lambda line: line["received_at_ns"])
    return lines


def is_of(line: Line, *kinds: str) -> bool:
    return line["key"].split("/")[3] in kinds


def test_a_recording_has_every_stream_in_order_of_arrival(recorded):
    lines = recorded.lines
    assert {line["key"].split("/")[3] for line in lines} == {
        "reading",
        "estimate",
        "fix",
        "feedback",
        "state",
        "hypotheses",
        "@sim",
    }
    assert [line["received_at_ns"] for line in lines] == sorted(line["received_at_ns"] for line in lines)


@pytest.mark.parametrize("origin", ["readings", "estimates"])
def test_a_rerun_settles_to_the_bytes_of_the_evaluation(recorded, tmp_path, origin):
    states = rerun(recorded.path, tmp_path / "states.jsonl", origin)
    assert len(states.splitlines()) >= DURATION_S * 50 - 2
    assert states == recorded.settled


def test_a_rerun_from_readings_ignores_recorded_estimates_fixes_and_feedback(recorded, tmp_path):
    # what a rerun from readings must not look at says something else here
    spoilt = [
        {**line, "payload": {**line["payload"], "position_m": 5.0}} if is_of(line, "fix") else line
        for line in recorded.lines
        if not is_of(line, "estimate", "feedback")
    ]
    recording, out = tmp_path / "spoilt.jsonl", tmp_path / "default.jsonl"
    recording.write_text("".join(json.dumps(line) + "\n" for line in spoilt), encoding="utf-8")
    assert milepost("rerun", recording, "--train", TRAIN, "--out", out).returncode == 0
    assert out.read_bytes() == recorded.settled


class TestShuffled:
    """Late by up to two seconds, out of order, 5 % twice."""

    def test_it_is_out_of_order_and_repeats(self, recorded, shuffled):
        stamps = [line["payload"]["measured_at_ns"] for line in shuffled]
        assert sum(b < a for a, b in pairwise(stamps)) > 0.3 * len(stamps)
        assert len(shuffled) > 1.03 * len(recorded.lines)

    def test_estimates_and_fixes_settle_to_the_same_bits(self, recorded, shuffled, tmp_path):
        assert rerun(shuffled, tmp_path / "states.jsonl", "estimates") == recorded.settled

    def test_readings_settle_within_a_micrometre_and_a_micrometre_a_second(self, recorded, shuffled, tmp_path):
        now = [json.loads(line) for line in rerun(shuffled, tmp_path / "states.jsonl", "readings").splitlines()]
        was = [json.loads(line) for line in recorded.settled.splitlines()]
        assert [state["epoch"] for state in now] == [state["epoch"] for state in was]
        assert max(abs(a["position_m"] - b["position_m"]) for a, b in zip(now, was, strict=True)) < 1e-6
        assert max(abs(a["speed_mps"] - b["speed_mps"]) for a, b in zip(now, was, strict=True)) < 1e-6

    def test_a_message_lost_is_noticed(self, recorded, shuffled, tmp_path):
        """The comparisons above can fail: without one balise fix the states are others."""
        fixes = [line["payload"]["measured_at_ns"] for line in shuffled if is_of(line, "fix")]
        less = [line for line in shuffled if not (is_of(line, "fix") and line["payload"]["measured_at_ns"] == min(fixes))]
        assert len(less) < len(shuffled)
        assert rerun(less, tmp_path / "states.jsonl", "estimates") != recorded.settled


def test_lines_without_a_receipt_time_settle_to_the_same_bytes(recorded, tmp_path):
    bare = [{key: value for key, value in line.items() if key != "received_at_ns"} for line in recorded.lines]
    assert rerun(bare, tmp_path / "states.jsonl", "readings") == recorded.settled


class TestMcap:
    """The same messages in a recorder's file."""

    def written(self, recorded: Recorded, path: Path, **facts: dict[str, str]) -> Path:
        file = RecordingFile(path)
        for name, each in facts.items():
            file.describe(name, each)
        for line in recorded.lines:
            kind = line["payload"]
            row = next(row for row in STREAMS if row.key_for(kind["train"], kind["unit"]) == line["key"] and accepts(row, kind))
            payload = encode(from_fields(kind, row.message))
            file.add(Incoming(line["key"], row.message.encoding(), line["received_at_ns"], payload), head_of(payload))
        file.close()
        return path

    @pytest.mark.parametrize("origin", ["readings", "estimates"])
    def test_it_settles_to_the_same_bytes(self, recorded, tmp_path, origin):
        made = self.written(recorded, tmp_path / "m.mcap")
        assert rerun(made, tmp_path / "states.jsonl", origin) == recorded.settled

    def test_a_folder_of_its_parts_settles_to_the_same_bytes(self, recorded, tmp_path):
        folder = tmp_path / "parts"
        folder.mkdir()
        half = len(recorded.lines) // 2
        for name, lines in (("a", recorded.lines[:half]), ("b", recorded.lines[half:])):
            part = tmp_path / f"{name}.jsonl"
            part.write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8")
            self.written(Recorded(part, b""), folder / f"{name}.mcap")
        assert rerun(folder, tmp_path / "states.jsonl", "readings") == recorded.settled

    def test_what_is_left_of_a_file_that_was_cut_off_settles_to_the_same_states(self, recorded, tmp_path):
        whole = self.written(recorded, tmp_path / "m.mcap").read_bytes()
        (tmp_path / "cut.mcap").write_bytes(whole[: len(whole) * 2 // 3])
        done = milepost(
            "rerun", tmp_path / "cut.mcap", "--train", TRAIN, "--out", tmp_path / "states.jsonl", "--from", "estimates"
        )
        assert f"{tmp_path}/cut.mcap: cut off: read as far as it goes" in done.stderr
        left = (tmp_path / "states.jsonl").read_bytes().splitlines()
        assert 50 < len(left) < len(recorded.settled.splitlines())
        assert left[:-1] == recorded.settled.splitlines()[: len(left) - 1]

    def test_receipts_of_a_train_that_ran_faster_are_in_scenario_time(self, recorded, tmp_path):
        """Twice as fast, the receipts are half as far from the start; without that, all would come too early."""
        start_ns = 1_700_000_000_000_000_000
        lines = [{**line, "received_at_ns": start_ns + (line["received_at_ns"] - start_ns) // 2} for line in recorded.lines]
        fast = tmp_path / "fast.jsonl"
        fast.write_text("".join(json.dumps(line) + "\n" for line in lines), encoding="utf-8")
        made = self.written(Recorded(fast, b""), tmp_path / "m.mcap", simulation=simulation_facts(start_ns, 2.0))
        assert rerun(made, tmp_path / "states.jsonl", "estimates") == recorded.settled
        assert rerun(fast, tmp_path / "others.jsonl", "estimates") != recorded.settled

    def test_other_settings_than_those_of_the_recording_are_told(self, recorded, tmp_path):
        made = self.written(recorded, tmp_path / "m.mcap", train={"file": "maglev.yaml", "fingerprint": "of another"})
        done = milepost("rerun", made, "--train", TRAIN, "--out", tmp_path / "states.jsonl")
        assert done.returncode == 0
        assert "recorded with other settings, or another version" in done.stderr.splitlines()[-1]
        assert "cut off" not in done.stderr
        assert (tmp_path / "states.jsonl").read_bytes() == recorded.settled

    def test_a_damaged_part_is_counted_and_reported(self, recorded, tmp_path):
        spoilt = bytearray(self.written(recorded, tmp_path / "m.mcap").read_bytes())
        spoilt[len(spoilt) // 3] ^= 0xFF
        (tmp_path / "spoilt.mcap").write_bytes(spoilt)
        done = milepost("rerun", tmp_path / "spoilt.mcap", "--train", TRAIN, "--out", tmp_path / "states.jsonl")
        assert "refused 1 as damaged; first: spoilt.mcap: message 1: " in done.stderr
        assert "Traceback" not in done.stderr


def accepts(row: Stream, fields: dict[str, Any]) -> bool:
    """Whether a payload is of a row: all readings have one key."""
    try:
        from_fields(fields, row.message)
    except Refused:
        return False
    return True


def test_invalid_lines_are_counted_and_reported(recorded, tmp_path):
    text = recorded.path.read_text(encoding="utf-8").splitlines()
    one = next(json.loads(line) for line in text if "/reading/radar" in line)
    other = json.dumps(
        {**one, "payload": {**one["payload"], "train": "another"}, "key": one["key"].replace("maglev-1", "another")}
    )
    endless = json.dumps({**one, "payload": {**one["payload"], "speed_mps": 1e9}})
    torn = text[100][: len(text[100]) // 2]
    rest = [*text[3:50], "", torn, "\x00\x01 noise", *text[50:200], other, endless, '{"key": 5}', "[]", *text[200:]]
    recording, out = tmp_path / "garbage.jsonl", tmp_path / "states.jsonl"
    recording.write_text("\n".join([*text[:3], *rest]) + "\n", encoding="utf-8")
    done = milepost("rerun", recording, "--train", TRAIN, "--out", out)
    assert done.returncode == 0
    refused = sorted(line for line in done.stderr.splitlines() if line.startswith("refused"))
    assert [line.split(";")[0] for line in refused] == [
        "refused 1 as other_train",
        "refused 2 as undecodable",
        "refused 3 as invalid",
    ]
    assert "first: line 52: not JSON" in refused[1]
    assert out.read_bytes() == recorded.settled


def refused_in_one_line(done: subprocess.CompletedProcess[str]) -> str:
    assert done.returncode == 2
    assert done.stdout == ""
    assert len(done.stderr.splitlines()) == 1, done.stderr
    assert done.stderr.startswith("milepost: ")
    return done.stderr


def test_a_missing_recording_is_one_line_and_exit_code_2(tmp_path):
    done = milepost("rerun", tmp_path / "none.jsonl", "--train", TRAIN, "--out", tmp_path / "out.jsonl")
    assert "none.jsonl: no such file" in refused_in_one_line(done)
    assert list(tmp_path.iterdir()) == []


def test_an_unknown_origin_is_one_line_and_exit_code_2(recorded, tmp_path):
    done = milepost("rerun", recorded.path, "--train", TRAIN, "--out", tmp_path / "out.jsonl", "--from", "nonsense")
    line = refused_in_one_line(done)
    assert "--from" in line
    assert "nonsense" in line
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_does_not_exist_is_one_line_and_exit_code_2(recorded, tmp_path):
    done = milepost("rerun", recorded.path, "--train", TRAIN, "--out", tmp_path / "none/out.jsonl")
    assert "does not exist" in refused_in_one_line(done)


def test_a_folder_as_the_file_to_write_is_one_line_and_exit_code_2(recorded, tmp_path):
    done = milepost("rerun", recorded.path, "--train", TRAIN, "--out", tmp_path)
    assert "is a folder" in refused_in_one_line(done)


# the command as it is, and a Ctrl-C that strikes at a known place: with the hundredth state
INTERRUPTED = """
import os, signal, sys
import milepost.cli.recording.rerun as rerun
from milepost.cli.entry import main

replay = rerun.replay

def interrupted(train, messages, from_estimates, settled, tap=None):
    count = 0

    def counted(state):
        nonlocal count
        settled(state)
        count += 1
        if count == 100:
            os.kill(os.getpid(), signal.SIGINT)

    replay(train, messages, from_estimates, counted, tap)

rerun.replay = interrupted
sys.argv[0] = "milepost"
main()
"""


def test_ctrl_c_leaves_no_partial_file(recorded, tmp_path):
    out = tmp_path / "out.jsonl"
    out.write_text("the states of an earlier rerun\n", encoding="utf-8")
    done = milepost("rerun", recorded.path, "--train", TRAIN, "--out", out, program=("-c", INTERRUPTED))
    assert done.returncode not in (0, 2)
    assert "Traceback" not in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["out.jsonl"]
    assert out.read_text(encoding="utf-8") == "the states of an earlier rerun\n"


@pytest.mark.parametrize(("name", "says"), [("metro", "other_train"), ("maglev", "undecodable")])
def test_a_rerun_that_used_nothing_writes_nothing_and_says_why(recorded, tmp_path, name, says):
    recording = recorded.path if name == "metro" else ROOT / "README.md"
    out = tmp_path / "states.jsonl"
    out.write_text("kept\n", encoding="utf-8")
    done = milepost("rerun", recording, "--train", name, "--out", out)
    assert done.returncode == 1
    assert says in done.stderr.splitlines()[-1]
    assert out.read_text(encoding="utf-8") == "kept\n"


def test_a_scenarios_recording_is_rerun_with_the_scenarios_train(tmp_path):
    """The scenario lays a sharper prior over the train file; without it the first states would be wider."""
    scenario, recording, out = tmp_path / "sharp.yaml", tmp_path / "m.jsonl", tmp_path / "states.jsonl"
    change = "change: {prior: {position_std_m: 0.02}}"
    scenario.write_text(f"scenario: sharp\ntrain: {TRAIN}\nduration_s: 2.0\n{change}\n", encoding="utf-8")
    assert milepost("evaluate", scenario, "--record", recording).returncode == 0
    done = milepost("rerun", recording, "--scenario", scenario, "--out", out)
    assert done.returncode == 0, done.stderr
    first = json.loads(out.read_text(encoding="utf-8").splitlines()[0])
    assert first["covariance"][0][0] == pytest.approx(0.02**2, rel=0.5)
