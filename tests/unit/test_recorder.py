"""Recordings hold every byte that came, whatever ends them; files follow one another; a full disk stops them and says so."""

from __future__ import annotations

import errno
import os
import random
import struct
import time
from collections.abc import Iterator
from pathlib import Path

import msgpack
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.writer import Writer

from examples import T0, examples_of, head
from milepost.config.errors import ConfigError
from milepost.recorder.file import MOST_CHANNELS, RecordingFile
from milepost.recorder.gaps import Gaps, Run
from milepost.recorder.history import BadQuestionError, History, seconds_asked_for
from milepost.recorder.incoming import Incoming, head_of
from milepost.recorder.limits import MIB, Limits
from milepost.recorder.reading import McapReader, recordings_in
from milepost.recorder.recorder import LOOK_AGAIN_NS, Recorder
from milepost.recorder.scenario_clock import ScenarioClock, simulation_facts
from milepost.recorder.several import MOST_SYNCED, Several
from milepost.recorder.summary import Summary
from milepost.runtime.recording.intake import EACH_BYTES, Intake
from milepost.runtime.recording.writer import WriterThread
from milepost_schemas import BY_NAME, SpeedReading, encode

KEY = "milepost/v1/maglev-1/reading/radar"
ENCODING = SpeedReading.encoding()
SECOND = 1_000_000_000


def message(sequence: int, key: str = KEY, at_ns: int | None = None) -> Incoming:
    reading = SpeedReading(**head(sequence=sequence), speed_mps=20.0 + sequence * 1e-3, speed_variance_m2ps2=0.04)
    return Incoming(key, ENCODING, T0 + sequence if at_ns is None else at_ns, encode(reading))


def recorded(path: Path) -> list[Incoming]:
    return list(McapReader(path).messages())


class Disk:
    """A disk with as much room as a test says."""

    def __init__(self, free: int = 10 * MIB) -> None:
        self.free = free

    def __call__(self, folder: Path) -> int:
        return self.free


def recorder(folder: Path, disk: Disk | None = None, **limits: float) -> Recorder:
    return Recorder(folder, "maglev-1", Limits(**{"least_free_bytes": MIB, **limits}), T0, disk or Disk())  # type: ignore[arg-type]


def codes(of: Recorder) -> list[str]:
    return [notice.code for notice in of.notices]


class TestAFile:
    def test_messages_come_back_byte_for_byte_in_order_of_arrival(self, tmp_path: Path) -> None:
        sent = [message(n) for n in range(500)]
        random.Random(3).shuffle(sent)
        file = RecordingFile(tmp_path / "a.mcap")
        for each in sent:
            file.add(each, head_of(each.payload))
        file.close()
        reader = McapReader(tmp_path / "a.mcap")
        assert list(reader.messages()) == sent
        assert reader.whole
        assert reader.damaged == []
        assert reader.read_bytes == (tmp_path / "a.mcap").stat().st_size

    def test_what_is_no_message_of_ours_comes_back_as_it_came(self, tmp_path: Path) -> None:
        sent = [
            Incoming(KEY, ENCODING, T0, b"\xc1 garbage"),
            Incoming(KEY, "text/plain", T0, b"hello"),
            Incoming(KEY, "application/msgpack;of_tomorrow/9", T0, msgpack.packb([1, 2])),
            Incoming("milepost/v1/t/reading/x", "zenoh/bytes", T0, b""),
            Incoming(KEY, ENCODING, T0, msgpack.packb({"sequence": -1, "published_at_ns": 2**64 - 1, "instance": 5})),
        ]
        file = RecordingFile(tmp_path / "a.mcap")
        for each in sent:
            file.add(each, head_of(each.payload))
        file.close()
        assert recorded(tmp_path / "a.mcap") == sent

    def test_other_programs_find_times_sequence_schema_and_index(self, tmp_path: Path) -> None:
        file = RecordingFile(tmp_path / "a.mcap")
        for n in range(10):
            file.add(message(n), head_of(message(n).payload))
        file.close()
        with (tmp_path / "a.mcap").open("rb") as opened:
            reader = make_reader(opened, validate_crcs=True)
            summary = reader.get_summary()
            found = list(reader.iter_messages(topics=[KEY]))
        assert summary is not None
        assert summary.statistics is not None
        assert summary.statistics.message_count == 10
        assert [index.compression for index in summary.chunk_indexes] == ["zstd"]
        schema, channel, first = found[0]
        assert schema is not None
        assert (schema.name, schema.encoding, channel.message_encoding) == ("speed_reading/1", "jsonschema", "msgpack")
        assert (first.log_time, first.publish_time, first.sequence) == (T0, head()["published_at_ns"], 0)

    def test_a_file_is_never_written_over(self, tmp_path: Path) -> None:
        RecordingFile(tmp_path / "a.mcap").close()
        with pytest.raises(FileExistsError):
            RecordingFile(tmp_path / "a.mcap")

    def test_a_stranger_who_invents_keys_does_not_end_the_recording(self, tmp_path: Path) -> None:
        made = recorder(tmp_path)
        for n in range(MOST_CHANNELS + 5):
            made.add(Incoming(f"milepost/v1/maglev-1/reading/x{n}", ENCODING, T0, b""))
        made.add(Incoming("milepost/v1/maglev-1/reading/x0", ENCODING, T0, b"on"))
        made.close(T0)
        assert made.refused == {"too_many_keys": 5}
        assert recorded(made.files[0])[-1].payload == b"on"


@pytest.fixture(scope="module")
def three_chunks(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """Three flushed chunks of ten messages, the third with a key of its own, without an end, as SIGKILL leaves it."""
    path = tmp_path_factory.mktemp("cut") / "a.mcap"
    file = RecordingFile(path)
    for chunk in range(3):
        for n in range(10):
            file.add(message(10 * chunk + n, KEY if chunk < 2 else KEY + "-2"), head_of(b""))
        file.flush()
    found = path.read_bytes()
    file.abandon()
    return found


class TestACutOffFile:
    def test_everything_that_was_flushed_is_read(self, tmp_path: Path, three_chunks: bytes) -> None:
        path = tmp_path / "cut.mcap"
        path.write_bytes(three_chunks)
        reader = McapReader(path)
        assert len(list(reader.messages())) == 30
        assert not reader.whole
        assert reader.damaged == []

    def test_its_size_is_that_of_the_file(self, tmp_path: Path, three_chunks: bytes) -> None:
        """With what stands behind the last record that can be read."""
        path = tmp_path / "cut.mcap"
        path.write_bytes(three_chunks + b"\x06 and no more")
        (found,) = Summary().read([path]).as_dict()["files"]
        assert found["bytes"] == len(three_chunks) + len(b"\x06 and no more")

    def test_at_every_byte_it_gives_whole_chunks_and_no_error(self, tmp_path: Path, three_chunks: bytes) -> None:
        path, counts = tmp_path / "cut.mcap", set()
        for size in range(8, len(three_chunks), 7):
            path.write_bytes(three_chunks[:size])
            reader = McapReader(path)
            counts.add(len(list(reader.messages())))
            assert not reader.whole
            assert reader.damaged == []
        assert counts == {0, 10, 20, 30}

    def test_a_damaged_chunk_takes_no_other_with_it(self, tmp_path: Path, three_chunks: bytes) -> None:
        # the second chunk: find the second record with the opcode of chunks
        at, seen = 8, 0
        while True:
            opcode, length = struct.unpack_from("<BQ", three_chunks, at)
            seen += opcode == 0x06
            if seen == 2:
                break
            at += 9 + length
        spoilt = bytearray(three_chunks)
        spoilt[at + 9 + length - 20] ^= 0xFF
        path = tmp_path / "spoilt.mcap"
        path.write_bytes(spoilt)
        reader = McapReader(path)
        assert len(list(reader.messages())) == 20
        assert len(reader.damaged) == 1

    @settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
    @given(data=st.data())
    def test_any_flipped_bytes_end_in_no_traceback(self, tmp_path: Path, three_chunks: bytes, data: st.DataObject) -> None:
        spoilt = bytearray(three_chunks)
        for _ in range(data.draw(st.integers(1, 8))):
            spoilt[data.draw(st.integers(8, len(spoilt) - 1))] = data.draw(st.integers(0, 255))
        path = tmp_path / "spoilt.mcap"
        path.write_bytes(spoilt)
        assert len(list(McapReader(path).messages())) <= 30
        Summary().read([path])

    def test_one_flipped_byte_of_a_finished_file_loses_no_message_unsaid(self, tmp_path: Path) -> None:
        """GIVEN a finished file, WHEN any of its bytes is another, THEN all messages are read, or it says what is damaged."""
        made = RecordingFile(tmp_path / "whole.mcap")
        for chunk in range(3):
            for n in range(10):
                made.add(message(10 * chunk + n), head_of(b""))
            made.flush()
        made.close()
        whole = (tmp_path / "whole.mcap").read_bytes()
        sent, unsaid, lost = recorded(tmp_path / "whole.mcap"), [], 0
        path = tmp_path / "spoilt.mcap"
        # a step that meets every field of the headers of records at some place; all of the beginning and of the end
        for place in (*range(8), *range(8, len(whole), 5), *range(len(whole) - 40, len(whole))):
            path.write_bytes(whole[:place] + bytes([whole[place] ^ 0xC1]) + whole[place + 1 :])
            McapReader(path).read_metadata()
            reader = McapReader(path)
            found = list(reader.messages())
            assert all(each.rpartition(": ")[2] for each in reader.damaged), "no reason"
            lost += found != sent
            if found != sent and reader.whole and not reader.damaged:
                unsaid.append(place)
            # what is damaged takes no other chunk with it
            assert len(found) >= 20 or not reader.whole
        assert len(sent) == 30
        assert lost > 0
        assert unsaid == []

    @pytest.mark.parametrize("change", [-700, -9, -1, 1, 9, 700])
    @pytest.mark.parametrize("ended", [True, False])
    def test_bytes_that_are_missing_or_too_many_take_one_chunk_and_that_is_said(
        self, tmp_path: Path, ended: bool, change: int
    ) -> None:
        """GIVEN a file WHEN bytes are cut out of a chunk, or put in, THEN the chunks after it are read, and all is told."""
        made = RecordingFile(tmp_path / "whole.mcap")
        noise = random.Random(1)
        for chunk in range(4):
            for n in range(10):
                made.add(Incoming(KEY, ENCODING, T0 + 10 * chunk + n, noise.randbytes(300)), head_of(b""))
            made.flush()
        if ended:
            made.close()
        whole = (tmp_path / "whole.mcap").read_bytes()
        sent = recorded(tmp_path / "whole.mcap")
        at = whole.index(sent[15].payload)
        path = tmp_path / "spoilt.mcap"
        path.write_bytes(whole[:at] + (noise.randbytes(change) + whole[at:] if change > 0 else whole[at - change :]))
        reader = McapReader(path)
        found = list(reader.messages())
        assert [each for each in sent if each in found] == found
        assert found[:10] == sent[:10]
        assert found[-20:] == sent[-20:]
        assert reader.damaged
        assert not reader.whole
        if not ended:
            made.abandon()

    def test_a_file_that_was_only_opened_is_cut_off_and_empty(self, tmp_path: Path) -> None:
        for size in range(8):
            (tmp_path / "a.mcap").write_bytes(b"\x89MCAP0\r\n"[:size])
            reader = McapReader(tmp_path / "a.mcap")
            assert list(reader.messages()) == []
            assert (reader.whole, reader.damaged) == (False, [])

    def test_a_file_in_the_making_can_be_read(self, tmp_path: Path) -> None:
        made = recorder(tmp_path)
        made.add(message(1))
        made.check(T0 + SECOND)
        made.add(message(2))
        assert [each.payload for each in recorded(made.files[0])] == [message(1).payload]


def test_what_is_no_mcap_file_is_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "a.mcap").write_bytes(b"hello, this is no recording")
    with pytest.raises(ConfigError, match="is no MCAP file"):
        recorded(tmp_path / "a.mcap")
    with pytest.raises(ConfigError, match="no such file"):
        recordings_in(tmp_path / "none.mcap")
    (tmp_path / "empty").mkdir()
    with pytest.raises(ConfigError, match=r"has no \.mcap files"):
        recordings_in(tmp_path / "empty")


def test_files_of_other_programs_without_chunks_or_metadata_are_read(tmp_path: Path) -> None:
    path = tmp_path / "other.mcap"
    with path.open("wb") as file:
        writer = Writer(file, use_chunking=False)
        writer.start()
        schema = writer.register_schema("speed_reading/1", "jsonschema", b"{}")
        channel = writer.register_channel(KEY, "msgpack", schema)
        writer.add_message(channel, T0, message(1).payload, T0)
        writer.finish()
    assert recorded(path) == [message(1, at_ns=T0)]


class TestRotation:
    def test_a_new_file_begins_at_the_size_and_nothing_is_missing(self, tmp_path: Path) -> None:
        made = recorder(tmp_path, rotate_bytes=4000)
        noise = random.Random(1)
        sent = [Incoming(KEY, ENCODING, T0 + n, noise.randbytes(500)) for n in range(60)]
        for n, each in enumerate(sent):
            made.add(each)
            if n % 5 == 4:
                made.check(T0 + n * SECOND)
        made.close(T0)
        assert len(made.files) >= 5
        assert recordings_in(tmp_path) == made.files, "by name is by time"
        assert [each for file in made.files for each in recorded(file)] == sent
        assert all(McapReader(file).read_metadata() == {} for file in made.files)

    def test_a_new_file_begins_after_the_time(self, tmp_path: Path) -> None:
        made = recorder(tmp_path, rotate_s=10.0)
        for second in range(25):
            made.add(message(second, at_ns=T0 + second * SECOND))
            made.check(T0 + second * SECOND)
        made.close(T0)
        assert [len(recorded(file)) for file in made.files] == [11, 10, 4]

    def test_every_file_says_what_is_known_of_the_recording(self, tmp_path: Path) -> None:
        made = recorder(tmp_path, rotate_s=10.0)
        made.describe("simulation", simulation_facts(T0, 2.0), T0)
        made.check(T0 + 20 * SECOND)
        made.close(T0)
        assert len(made.files) == 2
        for file in made.files:
            assert ScenarioClock.of(McapReader(file).read_metadata()) == ScenarioClock(T0, 2.0)

    def test_two_recorders_in_one_folder_share_no_file(self, tmp_path: Path) -> None:
        first, second = recorder(tmp_path), recorder(tmp_path)
        assert first.files[0] != second.files[0]


class TestTheDisk:
    def test_it_stops_below_the_least_room_and_the_file_is_whole(self, tmp_path: Path) -> None:
        disk = Disk()
        made = recorder(tmp_path, disk)
        made.add(message(1))
        disk.free = MIB - 1
        made.check(T0 + SECOND)
        made.add(message(2))
        assert not made.recording
        assert made.refused == {"disk": 1}
        (notice,) = made.notices
        assert (notice.severity, notice.code) == ("error", "recording_stopped")
        assert "0 MiB free, less than 1 MiB" in notice.text
        reader = McapReader(made.files[0])
        assert [each.payload for each in reader.messages()] == [message(1).payload]
        assert reader.whole

    def test_it_goes_on_where_there_is_room_again(self, tmp_path: Path) -> None:
        disk = Disk()
        made = recorder(tmp_path, disk)
        disk.free = 0
        made.check(T0 + SECOND)
        made.add(message(1))
        disk.free = MIB + 1  # barely: it would stop at once
        made.check(T0 + SECOND + LOOK_AGAIN_NS)
        assert not made.recording
        disk.free = 2 * MIB
        made.check(T0 + SECOND + 3 * LOOK_AGAIN_NS)
        made.add(message(2))
        made.check(T0 + 2 * SECOND + 3 * LOOK_AGAIN_NS)
        made.close(T0)
        assert codes(made) == ["recording_stopped", "recording_resumed"]
        assert "1 messages are missing" in made.notices[-1].text
        assert [each.payload for each in recorded(made.files[-1])] == [message(2).payload]

    def test_it_begins_stopped_where_there_is_no_room(self, tmp_path: Path) -> None:
        made = recorder(tmp_path, Disk(0))
        assert not made.recording
        assert codes(made) == ["recording_stopped"]
        assert list(tmp_path.iterdir()) == []

    def test_a_disk_that_refuses_costs_what_was_not_flushed_and_says_so_once(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        made = recorder(tmp_path)
        made.add(message(1))
        made.check(T0 + SECOND)
        made.add(message(2))

        def full(_: int) -> None:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        with monkeypatch.context() as patch:
            patch.setattr("os.fdatasync", full)
            made.check(T0 + 2 * SECOND)
            made.check(T0 + 3 * SECOND)
        assert made.refused == {"disk": 1}
        assert codes(made) == ["recording_stopped"]
        assert "No space left on device" in made.notices[0].text
        made.check(T0 + 2 * SECOND + 2 * LOOK_AGAIN_NS)
        made.add(message(3))
        made.check(T0 + 3 * SECOND + 2 * LOOK_AGAIN_NS)
        made.close(T0)
        assert codes(made) == ["recording_stopped", "recording_resumed"]
        assert message(1).payload in [each.payload for each in recorded(made.files[0])]

    def test_a_disk_that_goes_on_refusing_is_not_littered_with_empty_files(
        self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        def full(_: int) -> None:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

        made = recorder(tmp_path)
        monkeypatch.setattr("os.fdatasync", full)
        for second in range(60):
            made.add(message(second))
            made.check(T0 + second * SECOND)
        assert codes(made) == ["recording_stopped"]
        assert list(tmp_path.iterdir()) == made.files
        assert len(made.files) <= 1
        assert made.refused == {"disk": 60}

    def test_a_folder_that_cannot_be_is_one_line(self, tmp_path: Path) -> None:
        (tmp_path / "file").write_text("")
        with pytest.raises(ConfigError, match="cannot record there"):
            recorder(tmp_path / "file")


class TestGaps:
    @pytest.mark.parametrize(
        ("sequences", "missing", "gaps", "repeated"),
        [
            ([0, 1, 2], 0, [], 0),
            ([0, 3, 4], 2, [(1, 2)], 0),
            ([0, 3, 1, 2], 0, [], 0),
            ([0, 5, 2], 3, [(1, 1), (3, 4)], 0),
            ([4, 2, 7], 3, [(3, 3), (5, 6)], 0),
            ([1, 1, 2, 2], 0, [], 2),
        ],
    )
    def test_missing_numbers_are_those_that_never_came(
        self, sequences: list[int], missing: int, gaps: list[tuple[int, int]], repeated: int
    ) -> None:
        counted = Gaps()
        for sequence in sequences:
            counted.note("radar", sequence)
        run = counted.runs["radar"]
        assert (run.missing, run.gaps, run.repeated) == (missing, gaps, repeated)
        assert counted.missing == missing

    @given(st.permutations(range(12)), st.sets(st.integers(0, 11), min_size=1))
    def test_order_does_not_matter(self, order: list[int], came: set[int]) -> None:
        sequences = [n for n in order if n in came]
        run = Run(sequences[0], sequences[0] + 1)
        for n in sequences[1:]:
            run.note(n)
        missing = set(range(min(came), max(came) + 1)) - came
        assert run.missing == len(missing)
        assert {n for low, high in run.gaps for n in range(low, high + 1)} == missing

    def test_a_summary_names_who_misses_what(self, tmp_path: Path) -> None:
        made = recorder(tmp_path)
        for n in (0, 1, 4):
            made.add(message(n))
        made.close(T0)
        found = Summary().read(made.files).as_dict()
        assert found["trains"] == ["maglev-1"]
        (stream,) = found["streams"]
        assert (stream["stream"], stream["units"], stream["messages"], stream["missing"]) == ("speed_reading", ["radar"], 3, 2)
        (sender,) = found["senders"]
        assert (sender["unit"], sender["instance"], sender["gaps"]) == ("radar", "a1b2c3d4", [[2, 3]])
        assert made.gaps.missing == 2


class Sample:
    """What of a Zenoh sample is asked for."""

    encoding = ENCODING

    def __init__(self, payload: bytes) -> None:
        self.payload = self
        self._bytes = payload

    def __len__(self) -> int:
        return len(self._bytes)

    def to_bytes(self) -> bytes:
        return self._bytes


class TestTheIntake:
    def test_what_is_too_much_is_counted_and_never_waits(self) -> None:
        intake = Intake(most_bytes=10 * (EACH_BYTES + 100), most_of_a_key_bytes=4 * (EACH_BYTES + 100))
        for n in range(6):
            intake.put("flood", n, Sample(bytes(100)))
        assert intake.lost == 2, "one key may not take it all"
        for n in range(10):
            intake.put(f"key-{n}", n, Sample(bytes(100)))
        assert intake.lost == 6
        for _ in range(4):
            assert intake.get(0.0).key == "flood"
        intake.put("flood", 9, Sample(bytes(100)))
        assert intake.lost == 6

    def test_a_disk_that_hangs_for_a_moment_costs_nothing(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        made, intake = recorder(tmp_path), Intake()
        hung: Iterator[float] = iter([0.3, *([0.0] * 100)])
        monkeypatch.setattr("os.fdatasync", lambda _: time.sleep(next(hung)))
        writer = WriterThread(made, intake, pytest.fail)
        for n in range(2000):
            intake.put(KEY, T0 + n, Sample(message(n).payload))
        writer.end()
        assert intake.lost == 0
        assert [each.payload for each in recorded(made.files[0])] == [message(n).payload for n in range(2000)]

    def test_a_bug_in_the_writer_is_not_silent(self, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        made, intake, failed = recorder(tmp_path), Intake(), []
        monkeypatch.setattr(made, "add", lambda _: 1 / 0)
        writer = WriterThread(made, intake, lambda: failed.append(True))
        intake.put(KEY, T0, Sample(b""))
        with pytest.raises(ZeroDivisionError):
            writer.end()
        assert failed == [True]


def test_scenario_time_is_that_of_the_live_clock() -> None:
    clock = ScenarioClock.of({"simulation": simulation_facts(T0, 2.5)})
    assert clock.at(T0) == T0
    assert clock.at(T0 + 4 * SECOND) == T0 + 10 * SECOND
    assert ScenarioClock.of({}).at(T0 + 5) == T0 + 5
    assert ScenarioClock.of({"simulation": {"start_ns": "soon"}}) == ScenarioClock()


def test_the_example_of_a_state_fits_its_row() -> None:
    assert all(head_of(encode(each)).published_ns == each.published_at_ns for each in examples_of(BY_NAME["state"]))


class TestHistory:
    def messages(self, history: History, count: int, every_ns: int = SECOND) -> list[Incoming]:
        sent = [message(n, at_ns=T0 + n * every_ns) for n in range(count)]
        for each in sent:
            history.add(each)
        return sent

    def test_it_answers_the_newest_or_the_last_seconds_oldest_first(self) -> None:
        history = History()
        assert history.answer(None, T0) == []
        sent = self.messages(history, 10)
        now_ns = T0 + 9 * SECOND
        assert history.answer(None, now_ns) == sent[-1:]
        assert history.answer(3.0, now_ns) == sent[-4:]
        assert history.answer(3.0, now_ns + 60 * SECOND) == []
        assert history.answer(None, now_ns + 60 * SECOND) == sent[-1:], "the newest is kept however old it is"

    def test_it_drops_what_is_too_old_or_too_much(self) -> None:
        old = History(kept_s=5.0)
        sent = self.messages(old, 20)
        assert old.answer(300.0, T0) == sent[-6:]
        small = History(most_bytes=3 * len(sent[0].payload) + 10)
        self.messages(small, 20)
        assert len(small.answer(300.0, T0)) == 3

    @pytest.mark.parametrize(
        ("parameters", "seconds"), [("", None), ("seconds=60", 60.0), ("_time=[now(-1h)..];seconds=0.5", 0.5)]
    )
    def test_a_question_says_how_far_back(self, parameters: str, seconds: float | None) -> None:
        assert seconds_asked_for(parameters) == seconds

    @pytest.mark.parametrize(
        "parameters", ["seconds=", "seconds=all", "seconds=-1", "seconds=nan", "seconds=1e9", "second=5", "seconds=5;b"]
    )
    def test_a_question_that_makes_no_sense_is_told_why(self, parameters: str) -> None:
        with pytest.raises(BadQuestionError, match=r"^(seconds|second|b): "):
            seconds_asked_for(parameters)


def test_of_several_trains_each_file_is_handed_over_at_every_other_check(tmp_path: Path) -> None:
    """GIVEN three trains whose messages came, WHEN two checks are over, THEN a reader finds all that had come before."""
    names = [f"t-{n}" for n in range(3)]
    recorders = {name: Recorder(tmp_path, name, Limits(least_free_bytes=0), T0) for name in names}
    several = Several(recorders)
    for sequence in range(4):
        for name in names:
            several.add(message(sequence, f"milepost/v1/{name}/reading/radar"))
        for _ in range(2):
            several.check(T0 + sequence)
        assert [len(recorded(recorders[name].files[0])) for name in names] == [sequence + 1] * 3


def test_of_many_trains_the_disk_has_each_file_in_turn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN more trains than a check waits for, WHEN N / 10 checks are over, THEN the disk has taken the file of each."""
    synced: list[Path] = []

    def sync(file: RecordingFile) -> None:
        synced.append(file.path)
        file.flush()

    monkeypatch.setattr(RecordingFile, "sync", sync)
    names = [f"t-{n:02}" for n in range(4 * MOST_SYNCED)]
    several = Several({name: Recorder(tmp_path, name, Limits(least_free_bytes=0), T0) for name in names})
    for _ in range(4):
        several.check(T0)
        assert len(synced) % MOST_SYNCED == 0
    assert len(set(synced)) == len(synced) == len(names)
