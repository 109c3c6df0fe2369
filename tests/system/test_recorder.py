"""A recorder on a real bus: what it writes is what was sent, whatever ends it, and it gives the live fuser's states again."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import msgpack
import pytest
import yaml
import zenoh
from mcap.exceptions import EndOfFile
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader

from conftest import Outside, Stack, free_port, start
from examples import EXAMPLES, head
from milepost.config.roles import ROLES, Setting
from milepost.config.shipped_files import find_file
from milepost.config.train import load_train
from milepost.offline.message_log import Reader
from milepost.offline.run import OfflineRun
from milepost.recorder.file import RecordingFile
from milepost.recorder.incoming import Incoming, head_of
from milepost.recorder.reading import McapReader, recordings_in
from milepost.recorder.summary import Summary
from milepost.runtime import zenoh_config
from milepost.runtime.injecting.commands import send_command
from milepost_schemas import BY_NAME, SpeedReading, encode

pytestmark = pytest.mark.long

TOP = "milepost/v1/full-1"
SECOND = 1_000_000_000


def milepost(*words: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "milepost", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


@contextmanager
def recording(endpoint: str, folder: Path, *options: str) -> Iterator[tuple[subprocess.Popen[str], Outside]]:
    """A recorder of the full train that is there, and somebody outside who hears it."""
    outside = Outside(endpoint)
    outside.listen(f"{TOP}/**")
    command = [sys.executable, "-m", "milepost", "run", "recorder", "--record", str(folder), "--connect", endpoint, *options]
    recorder = subprocess.Popen([*command, "--parent", str(os.getpid())], stderr=subprocess.PIPE, text=True)
    try:
        outside.there(f"{TOP}/health/recorder")
        yield recorder, outside
    finally:
        outside.close()
        recorder.kill()
        recorder.wait(10.0)
        assert recorder.stderr is not None
        recorder.stderr.close()


def reading(sequence: int) -> bytes:
    message = SpeedReading(**head(sequence=sequence, train="full-1"), speed_mps=20.0, speed_variance_m2ps2=0.04)
    return encode(message)


def by_the_library_alone(path: Path, key: str) -> list[bytes]:
    """The payloads on a key as any program finds them in a file that may have no end."""
    channels: dict[int, str] = {}
    found: list[bytes] = []
    with path.open("rb") as file:
        try:
            for record in StreamReader(file, validate_crcs=True).records:
                if isinstance(record, Channel):
                    channels[record.id] = record.topic
                elif isinstance(record, Message) and channels[record.channel_id] == key:
                    found.append(record.data)
        except EndOfFile:
            pass
    return found


def test_a_killed_recorder_has_all_but_the_last_second(router: str, tmp_path: Path) -> None:
    """GIVEN 500 messages a second, WHEN the recorder is killed, THEN what was sent a second before is there, byte for byte."""
    key = f"{TOP}/reading/radar-front"
    with recording(router, tmp_path) as (recorder, outside):
        publisher = outside.session.declare_publisher(key, encoding=zenoh.Encoding(SpeedReading.encoding()))
        sent_at: list[float] = []
        begun = time.monotonic()
        while time.monotonic() < begun + 4.0:
            publisher.put(reading(len(sent_at)))
            sent_at.append(time.monotonic())
            time.sleep(0.002)
        recorder.send_signal(signal.SIGKILL)
        killed = time.monotonic()
        recorder.wait(5.0)
    (path,) = recordings_in(tmp_path)
    due = sum(at < killed - 1.0 for at in sent_at)
    assert due > 500
    found = by_the_library_alone(path, key)
    assert len(found) >= due
    assert found == [reading(n) for n in range(len(found))]
    # and the commands take the file as it is
    info = milepost("info", path, "--json")
    assert info.returncode == 0, info.stderr
    (file,) = json.loads(info.stdout)["files"]
    assert not file["whole"]
    assert file["damaged"] == []
    done = milepost("export", path, "--csv", tmp_path / "csv")
    assert done.returncode == 0, done.stderr
    assert len((tmp_path / "csv/speed_reading.csv").read_text().splitlines()) == len(found) + 1


def test_it_stops_in_order_and_loses_nothing_that_was_sent_before(router: str, tmp_path: Path) -> None:
    key = f"{TOP}/reading/radar-front"
    with recording(router, tmp_path) as (recorder, outside):
        encoding, block = zenoh.Encoding(SpeedReading.encoding()), zenoh.CongestionControl.BLOCK
        for n in range(3000):
            outside.session.put(key, reading(n), encoding=encoding, congestion_control=block)
        # what it counts says that it has it
        outside.wait_for(
            lambda: any("speed_reading" in m["received_hz"] for m in outside.messages(f"{TOP}/health/recorder")),
            10.0,
            "a count",
        )
        recorder.send_signal(signal.SIGTERM)
        assert recorder.wait(10.0) == 0
    (path,) = recordings_in(tmp_path)
    found = Summary().read([path])
    assert found.files[0].whole
    (run,) = [run for sender, run in found.senders.items() if sender.stream == "speed_reading"]
    assert (run.first, run.next, run.missing, run.repeated) == (0, 3000, 0, 0)


def test_below_the_least_room_it_says_so_on_the_bus_and_writes_nothing(router: str, tmp_path: Path) -> None:
    outside = Outside(router)
    outside.listen(f"{TOP}/event")
    with recording(router, tmp_path, "--least-free-mib", "1000000000") as (recorder, hears):
        event = outside.wait_for(lambda: outside.newest(f"{TOP}/event"), 10.0, "an event")
        assert event["code"] == "recording_stopped"  # type: ignore[index]
        assert event["severity"] == "error"  # type: ignore[index]
        outside.session.put(f"{TOP}/reading/radar-front", reading(1))
        hears.wait_for(
            lambda: hears.newest(f"{TOP}/health/recorder")["refused"].get("disk"), 10.0, "a count of what is missing"
        )
        recorder.send_signal(signal.SIGTERM)
        assert recorder.wait(10.0) == 0
    outside.close()
    assert list(tmp_path.iterdir()) == []


LIMITED = """
import resource, sys
resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000))
from milepost.cli.entry import main
main()
"""


def test_a_disk_that_takes_no_more_ends_a_file_and_not_the_recorder(router: str, tmp_path: Path) -> None:
    """GIVEN files of at most 60 kB, WHEN more comes, THEN it stops, says so, begins another, and what it wrote is there."""
    key, payload = f"{TOP}/reading/radar-front", os.urandom(400)
    outside = Outside(router)
    outside.listen(f"{TOP}/**")
    words = ("milepost", "run", "recorder", "--record", str(tmp_path), "--connect", router)
    recorder = subprocess.Popen([sys.executable, "-c", LIMITED, *words[1:]], stderr=subprocess.DEVNULL)
    try:
        outside.there(f"{TOP}/health/recorder")

        def codes() -> list[str]:
            for _ in range(20):
                outside.session.put(key, payload + os.urandom(200))
            return [event["code"] for event in outside.messages(f"{TOP}/event")]

        outside.wait_for(lambda: "recording_stopped" in codes(), 20.0, "it stops")
        outside.wait_for(lambda: "recording_resumed" in codes(), 20.0, "it goes on")
        assert recorder.poll() is None
    finally:
        recorder.send_signal(signal.SIGTERM)
        assert recorder.wait(10.0) == 0
        outside.close()
    files = recordings_in(tmp_path)
    assert len(files) >= 2
    assert all(len(by_the_library_alone(file, key)) > 10 or file != files[0] for file in files)
    assert all(McapReader(file).read_metadata() is not None for file in files)


def test_without_its_library_a_recorder_is_one_line_that_names_the_extra(tmp_path: Path) -> None:
    program = (
        "import sys; sys.modules['mcap'] = None; sys.modules['mcap.writer'] = None; from milepost.cli.entry import main; main()"
    )
    for words in (
        ("run", "recorder", "--record", str(tmp_path)),
        ("up", "--headless", "--record", str(tmp_path), "--listen", f"tcp/127.0.0.1:{free_port()}"),
        ("info", str(tmp_path)),
        ("export", str(tmp_path), "--csv", str(tmp_path)),
        ("replay", str(tmp_path)),
    ):
        command = [sys.executable, "-c", program, *words]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
        assert done.returncode == 2, words
        line = done.stderr.splitlines()[-1]
        assert "needs the extra `record` (pip install 'milepost[record]')" in line
        assert "Traceback" not in done.stderr


Banks = dict[int, object]


def note_banks(outside: Outside, found: Banks) -> None:
    """Each fuser's bank before the settled boundary, by the time of its last observation: it changes no more."""
    every = {"consolidation": zenoh.ConsolidationMode.NONE, "timeout": 5.0}
    for reply in outside.session.get(f"{TOP}/@rpc/snapshot/*", **every):
        part = msgpack.unpackb(reply.ok.payload.to_bytes()) if reply.ok is not None else {"part": None}
        if part["part"] == 0:
            bank, at_ns = msgpack.unpackb(part["content"])[-1][:2]
            found[at_ns or 0] = bank


@pytest.fixture(scope="module")
def drive(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Banks]:
    """A recorded run of the full train: a radar lies, another one's readings come late. And what its fusers had settled."""
    folder = tmp_path_factory.mktemp("drive") / "recording"
    banks: Banks = {}
    stack, outside = start("full", "--listen", f"tcp/127.0.0.1:{free_port()}", "--record", str(folder))
    try:
        outside.wait_state(f"{TOP}/state", lambda m: m["status"] == "normal", 60.0, "a normal state")
        # late readings rewind the fuser, and a rerun too: two seconds of them are enough
        for unit, kind, for_s, numbers in (
            ("radar-front", "bias", None, {"size": 2.0}),
            ("radar-rear", "delay", 2.0, {"by_s": 0.4}),
        ):
            fields = {"kind": kind, "for_s": for_s, "numbers": numbers, "words": {}, "flags": {}}
            assert send_command(stack.endpoints, "full-1", unit, fields).code == "fault_injected"

        def excludes(state: dict) -> bool:
            return any(entry["unit"] == "radar-front" for entry in state["excluded"])

        first = outside.wait_state(f"{TOP}/state", excludes, 20.0, "radar-front excluded")
        for n in range(1, 41):
            outside.wait_state(f"{TOP}/state", lambda m, n=n: m["epoch"] > first["epoch"] + 12 * n, 20.0, "more")
            note_banks(outside, banks)
    finally:
        outside.close()
        assert stack.stop() == 0, "".join(stack.errors)
    return folder, banks


def test_a_drive_is_recorded_from_its_first_message_to_its_last(drive: tuple[Path, Banks]) -> None:
    found = Summary().read(recordings_in(drive[0]))
    assert all(file.whole for file in found.files)
    assert {stream for _, stream in found.streams} >= {
        "speed_reading", "inertial_reading", "position_reading", "estimate", "feedback", "state", "event", "health", "truth",
        "chaos",
    }  # fmt: skip
    check_whole(found)


def check_whole(found: Summary) -> None:
    """From the first message on, nothing of cached streams is missing; of others at most what a busy machine drops."""
    for sender, run in found.senders.items():
        assert run.first == 0, sender
        assert run.missing <= (0 if BY_NAME[sender.stream].cached else 0.01 * run.came + 1), sender


def test_the_drive_has_readings_that_came_late(drive: tuple[Path, Banks]) -> None:
    late = [
        message
        for file in recordings_in(drive[0])
        for message in McapReader(file).messages()
        if message.key.endswith("/reading/radar-rear")
        and message.at_ns - msgpack.unpackb(message.payload)["measured_at_ns"] > 0.4 * SECOND
    ]
    assert len(late) > 10


@pytest.mark.parametrize("origin", ["readings", "estimates"])
def test_two_reruns_of_a_drive_are_the_same_bytes(drive: tuple[Path, Banks], tmp_path: Path, origin: str) -> None:
    outs = [tmp_path / "one.jsonl", tmp_path / "two.jsonl"]
    for out in outs:
        done = milepost("rerun", drive[0], "--from", origin, "--out", out)
        assert done.returncode == 0, done.stderr
    first, second = (out.read_bytes() for out in outs)
    assert first == second
    states = [json.loads(line) for line in first.splitlines()]
    assert any(entry["unit"] == "radar-front" for state in states for entry in state["excluded"])


def heard_by_all_until_ns(folder: Path) -> int:
    """The time of the first estimate that the network dropped on its way to the recorder or to a fuser; they sent with DROP."""
    until_ns, expected = 2**63, dict[tuple[str, str], int]()
    for message in (m for file in recordings_in(folder) for m in McapReader(file).messages()):
        stream, fields = message.key.split("/")[3], msgpack.unpackb(message.payload)
        if stream == "health" and fields["unit"] in ("fuser", "fuser-2") and fields["gaps"]:
            until_ns = min(until_ns, fields["measured_at_ns"] - 2 * SECOND)
        elif stream == "estimate":
            sender = (message.key, fields["instance"])
            if fields["sequence"] > expected.get(sender, 0):
                until_ns = min(until_ns, fields["measured_at_ns"] - SECOND)
            expected[sender] = fields["sequence"] + 1
    return until_ns


def test_a_rerun_from_estimates_settles_to_the_bits_of_the_live_fusers(drive: tuple[Path, Banks]) -> None:
    folder, banks = drive
    train = load_train(find_file(Path("full"), "trains"))
    node = ROLES["fuser"].build(train, "fuser", Setting("rerun"))
    run, now_ns, compared, until_ns = OfflineRun(train, [node]), 0, set(), heard_by_all_until_ns(folder)
    for stream, unit, message, received_ns in Reader(folder, train, ("estimate", "fix")).messages():
        now_ns = max(now_ns, received_ns)
        run.bus.run_until(now_ns)
        run.bus.inject(stream, unit, message, now_ns)
        kept = node.rule.kept()  # type: ignore[attr-defined]
        if kept is not None and kept.base_ns in banks and kept.base_ns < until_ns and kept.base_ns not in compared:
            compared.add(kept.base_ns)
            bank, at_ns = msgpack.unpackb(next(node.hand_over(now_ns)).content)[-1][:2]
            assert at_ns == kept.base_ns
            assert bank == banks[at_ns]
    assert len(compared) >= 3, f"{len(compared)} of {len(banks)}"


def test_a_replay_is_byte_for_byte_in_order_and_at_its_pace(drive: tuple[Path, Banks], router: str) -> None:
    messages = [m for file in recordings_in(drive[0]) for m in McapReader(file).messages() if "@chaos" not in m.key]
    expected: dict[str, list[bytes]] = {}
    for message in messages:
        expected.setdefault(message.key, []).append(message.payload)
    heard: dict[str, list[bytes]] = {}
    encodings: dict[str, set[str]] = {}
    outside = Outside(router)

    def receive(sample: zenoh.Sample) -> None:
        heard.setdefault(str(sample.key_expr), []).append(sample.payload.to_bytes())
        encodings.setdefault(str(sample.key_expr), set()).add(str(sample.encoding))

    kept = [outside.session.declare_subscriber(key, receive) for key in (f"{TOP}/**", f"{TOP}/@sim/**", f"{TOP}/@chaos/**")]
    try:
        begun = time.monotonic()
        done = milepost("replay", drive[0], "--speed", "5", "--connect", router)
        spent_s = time.monotonic() - begun
        assert done.returncode == 0, done.stderr
        count = sum(map(len, expected.values()))
        outside_has = lambda: sum(map(len, heard.values())) >= count  # noqa: E731
        deadline = time.monotonic() + 10.0
        while not outside_has() and time.monotonic() < deadline:
            time.sleep(0.01)
    finally:
        for each in kept:
            each.undeclare()
        outside.close()
    assert heard == expected
    assert encodings[f"{TOP}/state"] == {"application/msgpack;state/1"}
    span_s = (messages[-1].at_ns - messages[0].at_ns) * 1e-9
    assert spent_s >= span_s / 5


def test_trains_that_ran_at_the_same_time_are_replayed_at_the_same_time(router: str, tmp_path: Path) -> None:
    """GIVEN a folder with the recordings of two trains, THEN their messages come in the order in which they had come."""
    begun_ns, sent = time.time_ns(), []
    for place, train in enumerate(("red", "blue")):
        file = RecordingFile(tmp_path / f"{train}-20260101T000000Z-0000.mcap")
        for n in range(20):
            reading = SpeedReading(**head(train=train, sequence=n), speed_mps=float(n), speed_variance_m2ps2=1.0)
            at_ns = begun_ns + n * SECOND // 50 + place * SECOND // 100
            each = Incoming(f"milepost/v1/{train}/reading/radar", SpeedReading.encoding(), at_ns, encode(reading))
            file.add(each, head_of(each.payload))
            sent.append(each)
        file.close()
    heard: list[tuple[str, bytes]] = []
    outside = Outside(router)
    kept = outside.session.declare_subscriber(
        "milepost/v1/*/reading/radar", lambda sample: heard.append((str(sample.key_expr), sample.payload.to_bytes()))
    )
    try:
        done = milepost("replay", tmp_path, "--connect", router)
        outside.wait_for(lambda: len(heard) == len(sent), 10.0, "all messages")
    finally:
        kept.undeclare()
        outside.close()
    assert done.returncode == 0, done.stderr
    assert heard == [(each.key, each.payload) for each in sorted(sent, key=lambda each: each.at_ns)]


def test_a_replay_beside_its_live_train_is_refused(drive: tuple[Path, Banks], router: str, tmp_path: Path) -> None:
    with recording(router, tmp_path):  # a process of the train, by its token
        done = milepost("replay", drive[0], "--connect", router)
    assert done.returncode == 1
    assert "full-1 is running at this router (recorder, ...)" in done.stderr
    assert "Traceback" not in done.stderr


def test_a_recorder_that_was_killed_is_restarted_and_the_folder_is_one_recording(tmp_path: Path) -> None:
    folder = tmp_path / "recording"
    stack, outside = start("maglev", "--listen", f"tcp/127.0.0.1:{free_port()}", "--record", str(folder))
    try:
        outside.wait_state("milepost/v1/maglev-1/state", lambda m: m["status"] == "normal", 60.0, "a normal state")
        health = "milepost/v1/maglev-1/health/recorder"
        first = outside.there(health)["instance"]
        os.kill(stack.pid_of("recorder"), signal.SIGKILL)
        outside.wait_for(lambda: outside.newest(health)["instance"] != first, 20.0, "another recorder")
        outside.wait_for(
            lambda: len([m for m in outside.messages(health) if m["instance"] != first]) > 2, 20.0, "three seconds"
        )
    finally:
        outside.close()
        assert stack.stop() == 0, "".join(stack.errors)
    found = Summary().read(recordings_in(folder))
    assert [file.whole for file in found.files] == [False, True]
    out = tmp_path / "states.jsonl"
    done = milepost("rerun", folder, "--train", "maglev", "--out", out)
    assert done.returncode == 0, done.stderr
    assert "refused" not in done.stderr


def test_each_of_several_trains_has_a_recording_of_its_own_and_none_of_them_delays_the_end(tmp_path: Path) -> None:
    fleet, folder, names = tmp_path / "two.yaml", tmp_path / "recording", ["left-1", "right-1"]
    trains = [{"train": "maglev", "name": name, "start_after_s": float(n)} for n, name in enumerate(names)]
    fleet.write_text(yaml.safe_dump({"fleet": "two", "trains": trains}), encoding="utf-8")
    ports = ["--listen", f"tcp/127.0.0.1:{free_port()}", "--feed", free_port()]
    done = milepost("up", "--headless", "--fleet", fleet, "--duration", "3", "--record", folder, *ports)
    assert done.returncode == 0, done.stderr
    files = recordings_in(folder)
    assert [path.name.partition("-2")[0] for path in files] == names
    for name, path in zip(names, files, strict=True):
        found = Summary().read([path])
        assert {train for train, _ in found.streams} == {name}
        assert found.streams[name, "state"].messages >= 150
        check_whole(found)


def test_the_examples_are_messages_of_one_train() -> None:
    assert {message.train for messages in EXAMPLES.values() for message in messages} == {"maglev-1"}


def test_who_comes_late_asks_for_the_newest_state_and_for_the_last_minutes(router: str, tmp_path: Path) -> None:
    key, encoding = f"{TOP}/state", zenoh.Encoding("application/msgpack;state/1")
    with recording(router, tmp_path) as (_, outside):
        for n in range(500):
            outside.session.put(key, encode_state(n), encoding=encoding, congestion_control=zenoh.CongestionControl.BLOCK)
        outside.wait_for(
            lambda: any("state" in m["received_hz"] for m in outside.messages(f"{TOP}/health/recorder")), 10.0, "a count"
        )
        late = Outside(router)
        newest = [reply.ok for reply in late.session.get(key)]
        assert [each.payload.to_bytes() for each in newest if each] == [encode_state(499)]
        assert str(newest[0].encoding) == str(encoding)
        every = list(late.session.get(f"{key}?seconds=60", consolidation=zenoh.ConsolidationMode.NONE))
        assert [reply.ok.payload.to_bytes() for reply in every] == [encode_state(n) for n in range(500)]
        (wrong,) = late.session.get(f"{key}?seconds=soon")
        assert wrong.err.payload.to_string() == "seconds: a number, not 'soon'"
        late.close()


def encode_state(sequence: int) -> bytes:
    return encode(EXAMPLES["state"][0].model_copy(update={"train": "full-1", "sequence": sequence}))


def test_a_secure_train_is_recorded_without_a_refusal_and_its_tools_may_ask_for_what_was(tmp_path: Path) -> None:
    pytest.importorskip("cryptography")
    folder, top = tmp_path / "recording", "milepost/v1/maglev-1"
    stack = Stack("maglev", "--secure", "--state-dir", str(tmp_path / "state"), "--record", str(folder))
    try:
        dispatch = tmp_path / "state/pki/maglev-1/dispatch/session.json5"
        deadline = time.monotonic() + 40.0
        while not any(line.startswith("milepost: first state") for line in stack.errors):
            assert time.monotonic() < deadline, "".join(stack.errors)
            time.sleep(0.05)
        with zenoh.open(zenoh.Config.from_json5(json.dumps(zenoh_config.tool(dispatch)))) as session:
            last: list[int] = []
            while len(last) < 100 and time.monotonic() < deadline:
                asked = session.get(f"{top}/state?seconds=60", consolidation=zenoh.ConsolidationMode.NONE)
                last = [msgpack.unpackb(reply.ok.payload.to_bytes())["sequence"] for reply in asked if reply.ok]
            assert last == list(range(last[0], last[0] + len(last)))
    finally:
        code = stack.stop()
    assert code == 0, "".join(stack.errors)
    found = Summary().read(recordings_in(folder))
    assert {sender.stream for sender in found.senders} >= {"speed_reading", "estimate", "feedback", "state", "health", "truth"}
    check_whole(found)
    events = [
        msgpack.unpackb(m.payload) for m in McapReader(folder / found.files[0].path.name).messages() if m.key == f"{top}/event"
    ]
    assert not [event for event in events if event["code"] in ("access_refused", "connection_refused")]


def test_a_router_that_dies_costs_a_recording_no_state_and_no_feedback(tmp_path: Path) -> None:
    """GIVEN two routers, WHEN one is killed, THEN what its connections lost of cached streams is asked for again."""
    folder = tmp_path / "recording"
    stack, outside = start("full", "--listen", f"tcp/127.0.0.1:{free_port()}", "--record", str(folder))
    try:
        before = outside.wait_state(f"{TOP}/state", lambda m: m["status"] == "normal", 60.0, "a normal state")
        os.kill(stack.pid_of("router"), signal.SIGKILL)
        outside.wait_state(f"{TOP}/state", lambda m: m["epoch"] > before["epoch"] + 200, 30.0, "four seconds more")
    finally:
        outside.close()
        assert stack.stop() == 0, "".join(stack.errors)
    found = Summary().read(recordings_in(folder))
    runs = {sender: run for sender, run in found.senders.items() if BY_NAME[sender.stream].cached}
    assert {sender.stream for sender in runs} >= {"state", "feedback"}
    assert {sender: run.gaps for sender, run in runs.items() if run.missing} == {}
