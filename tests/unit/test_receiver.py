"""Receivers' bytes become fixes however they are cut; what is broken is counted and costs nothing but itself."""

from __future__ import annotations

import math
import os
import select
import socket
import sys
from itertools import pairwise
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from examples import head
from milepost.recordings.epochs import Decoder, Fix
from milepost.recordings.nmea import NmeaDecoder
from milepost.recordings.ubx import UbxDecoder
from milepost.sensors.gnss.receiver import POLL_S, RETRY_POLLS, LiveReceiver, ReceiverOptions, TcpStream, open_receiver
from milepost_schemas import PositionReading
from receivers import NOON, cov, frame, gga, gst, nmea_epoch, pvt, rmc, sentence, ubx_epoch


def decoded(decoder: Decoder, *pieces: bytes) -> list[Fix]:
    return [fix for piece in pieces for fix in decoder.feed(piece)] + decoder.finish()


# NMEA ---------------------------------------------------------------------------------------------------------------------


def test_the_sentences_of_one_time_are_one_fix() -> None:
    """50° 53.55035' = 50.8925058°, 4° 32.36227' = 4.5393712°; 19.438 kn = 10.0 m/s; √((0.03² + 0.04²)/2) = 0.03536 m."""
    ((utc_s, fields),) = decoded(NmeaDecoder(), nmea_epoch(0.0))
    assert utc_s == NOON
    assert fields == {
        "latitude_deg": pytest.approx(50.8925058, abs=1e-7),
        "longitude_deg": pytest.approx(4.5393712, abs=1e-7),
        "solution": "rtk_fixed",
        "altitude_m": 56.5,
        "satellites": 14,
        "hdop": 0.75,
        "speed_mps": pytest.approx(19.438 * 1852 / 3600),
        "course_deg": 271.2,
        "horizontal_std_m": pytest.approx(0.0353553, abs=1e-6),
    }
    PositionReading(**head("gnss"), **fields)


def test_south_and_west_are_negative() -> None:
    ((_, fields),) = decoded(NmeaDecoder(), rmc() + gga(place="3330.00000,S,07045.00000,W"))
    assert (fields["latitude_deg"], fields["longitude_deg"]) == (-33.5, -70.75)


@pytest.mark.parametrize(
    ("quality", "means"),
    [(0, "none"), (1, "single"), (2, "differential"), (4, "rtk_fixed"), (5, "rtk_float"), (6, "propagated"), (8, "none")],
)
def test_the_fix_quality_is_the_solution(quality: int, means: str) -> None:
    ((_, fields),) = decoded(NmeaDecoder(), rmc() + gga(quality=quality))
    assert fields["solution"] == means


def test_a_receiver_that_sends_no_gga_still_gives_a_fix() -> None:
    ((utc_s, fields),) = decoded(NmeaDecoder(), rmc())
    assert (utc_s, fields["solution"]) == (NOON, "rtk_fixed")
    assert "satellites" not in fields


def test_a_fix_is_told_as_soon_as_what_usually_comes_has_come() -> None:
    decoder = NmeaDecoder()
    assert decoder.feed(nmea_epoch(0.0)) == []  # nothing says yet that this was all
    assert [fix.utc_s for fix in decoder.feed(nmea_epoch(0.2))] == [NOON, NOON + 0.2]
    assert [fix.utc_s for fix in decoder.feed(nmea_epoch(0.4))] == [NOON + 0.4]
    assert decoder.finish() == []


def test_a_lost_sentence_costs_its_own_fields_and_no_fix() -> None:
    decoder = NmeaDecoder()
    told = decoded(decoder, *(nmea_epoch(0.2 * k) for k in range(4)), rmc(0.8) + gga(0.8), *(nmea_epoch(s) for s in (1.0, 1.2)))
    assert [round(fix.utc_s - NOON, 3) for fix in told] == [0.0, 0.2, 0.4, 0.6, 0.8, 1.0, 1.2]
    assert ["horizontal_std_m" in fix.fields for fix in told] == [True] * 4 + [False] + [True] * 2
    assert decoder.skipped == {}


def test_the_day_goes_on_at_midnight_though_only_rmc_says_the_date() -> None:
    told = decoded(NmeaDecoder(), rmc(hms="235959.80"), gga(hms="235959.90"), gga(hms="000000.00"), gga(hms="000000.10"))
    assert [round(b.utc_s - a.utc_s, 3) for a, b in pairwise(told)] == [0.1, 0.1, 0.1]
    assert told[0].utc_s == pytest.approx(NOON + 12 * 3600 - 0.2)


def test_without_a_date_there_is_no_fix_and_then_there_is() -> None:
    decoder = NmeaDecoder()
    told = decoded(decoder, gga(0.0), gga(1.0), *(gga(k) + rmc(k) for k in (2.0, 3.0)))
    assert [fix.utc_s for fix in told] == [NOON + 3.0]
    # the first RMC came when nobody waited for one
    assert decoder.skipped == {"no_date": 3, "late": 1}


def test_a_receiver_without_satellites_gives_no_fix() -> None:
    decoder = NmeaDecoder()
    assert (
        decoded(decoder, sentence("GNRMC,120000.00,V,,,,,,,250222,,,N") + sentence("GNGGA,120000.00,,,,,0,00,99.9,,,,,,")) == []
    )
    assert decoded(decoder, sentence("GNRMC,,V,,,,,,,,,,N")) == []
    assert decoder.skipped == {"no_position": 2}


NMEA_DIRT = {
    "garbage": (b"\x00\xff\x13 noise \r\n", "garbage"),
    "a wrong checksum": (gga(5.0).replace(b"5053.55", b"5054.55"), "checksum"),
    "a sentence cut off by the next": (gga(5.0)[:30], "truncated"),
    "a line without its checksum": (gga(5.0)[:30] + b"\r\n", "truncated"),
    "no line's end for ever": (b"$" + b"x" * 300, "truncated"),
    "a sentence that nobody knows": (sentence("PXYZ,1,2,3"), "foreign"),
    "a time that is none": (
        sentence("GNGGA,996199.00,5053.55035,N,00432.36227,E,4,14,0.75,56.5,M,46.0,M,1.0,0000"),
        "malformed",
    ),
    "fields that are not there": (sentence("GNRMC,120000.20,A,5053.55035,NG,0,0000,1"), "malformed"),
    "a sentence with nothing but its time": (sentence("GNGGA,120000.20"), "malformed"),
    "a number that is none": (sentence("GNGST,120000.20,1.0,,,,nought,0.04,0.05"), "malformed"),
}


@pytest.mark.parametrize("name", NMEA_DIRT)
def test_nmea_dirt_is_counted_by_reason_and_costs_no_other_sentence(name: str) -> None:
    dirt, reason = NMEA_DIRT[name]
    clean = decoded(NmeaDecoder(), *(nmea_epoch(0.2 * k) for k in range(4)))
    decoder = NmeaDecoder()
    assert decoded(decoder, nmea_epoch(0.0), dirt, *(nmea_epoch(0.2 * k) for k in range(1, 4))) == clean
    assert decoder.skipped.pop(reason) >= 1
    assert set(decoder.skipped) <= {"garbage"}


def test_sentences_that_say_nothing_of_the_fix_are_passed_over() -> None:
    decoder = NmeaDecoder()
    decoded(decoder, sentence("GPGSV,1,1,01,05,45,120,40") + sentence("GNVTG,271.2,T,,M,19.4,N,36.0,K,R") + nmea_epoch(0.0))
    assert decoder.skipped == {}


@pytest.mark.parametrize("cut", range(1, len(gst())))
def test_a_stream_that_ends_anywhere_in_its_last_sentence_still_gives_the_fix(cut: int) -> None:
    decoder = NmeaDecoder()
    (fix,) = decoded(decoder, rmc() + gga() + gst()[:cut])
    whole = cut >= len(gst()) - 2  # the line's end is not needed
    assert ("horizontal_std_m" in fix.fields) == whole
    assert decoder.skipped == ({} if whole else {"truncated": 1})


# UBX ----------------------------------------------------------------------------------------------------------------------


def test_the_messages_of_one_time_of_week_are_one_fix() -> None:
    ((utc_s, fields),) = decoded(UbxDecoder(), ubx_epoch(3))
    assert utc_s == NOON + 3
    assert fields == {
        "latitude_deg": pytest.approx(50.8925058),
        "longitude_deg": pytest.approx(4.5393712),
        "solution": "rtk_fixed",
        "altitude_m": pytest.approx(56.5),
        "satellites": 17,
        "horizontal_std_m": pytest.approx(math.sqrt((9e-4 + 16e-4) / 2), rel=1e-6),
        "speed_mps": pytest.approx(10.0),
        "speed_std_mps": pytest.approx(0.25),
        "course_deg": pytest.approx(271.2),
    }
    PositionReading(**head("gnss"), **fields)


@pytest.mark.parametrize("rest", [b"", cov(3, valid=0)])
def test_without_a_covariance_the_radial_figure_is_shared_by_the_axes(rest: bytes) -> None:
    ((_, fields),) = decoded(UbxDecoder(), pvt(3) + rest)
    assert fields["horizontal_std_m"] == pytest.approx(0.014 / math.sqrt(2))


def test_a_receivers_nanoseconds_may_be_negative() -> None:
    told = decoded(UbxDecoder(), pvt(3, nano=-120_000), pvt(3, nano=200_000_000))
    assert [fix.utc_s - NOON for fix in told] == pytest.approx([2.99988, 3.2], abs=1e-6)


@pytest.mark.parametrize(
    ("fix", "flags", "means"),
    [
        (3, 0x01, "single"),
        (2, 0x01, "single"),
        (3, 0x03, "differential"),
        (3, 0x43, "rtk_float"),
        (3, 0x83, "rtk_fixed"),
        (4, 0x83, "rtk_fixed"),
        (1, 0x01, "propagated"),
        (3, 0x00, "none"),
    ],
)
def test_fix_type_and_flags_are_the_solution(fix: int, flags: int, means: str) -> None:
    ((_, fields),) = decoded(UbxDecoder(), pvt(fix=fix, flags=flags))
    assert fields["solution"] == means


@pytest.mark.parametrize(
    ("message", "reason"),
    [
        (pvt(fix=0), "no_position"),
        (pvt(fix=5), "no_position"),
        (pvt(flags3=1), "no_position"),
        (pvt(valid=2), "no_date"),
        (pvt(valid=1), "no_date"),
    ],
)
def test_what_a_receiver_does_not_know_yet_gives_no_fix(message: bytes, reason: str) -> None:
    decoder = UbxDecoder()
    assert decoded(decoder, message) == []
    assert decoder.skipped == {reason: 1}


UBX_DIRT = {
    "garbage": (b"\x00\x01\xb5 noise", "garbage"),
    "sentences of the other protocol": (gga(), "garbage"),
    "a wrong checksum": (pvt(9)[:-1] + b"\x00", "checksum"),
    "a frame cut off by the next": (pvt(9)[:50], "checksum"),
    "a length beyond all bounds": (b"\xb5\x62\x01\x07\xff\xff", "checksum"),
    "a length that the message cannot have": (frame(b"\x01\x07", b"\x00" * 10), "malformed"),
}


@pytest.mark.parametrize("name", UBX_DIRT)
def test_ubx_dirt_is_counted_by_reason_and_costs_no_other_frame(name: str) -> None:
    dirt, reason = UBX_DIRT[name]
    clean = decoded(UbxDecoder(), *(ubx_epoch(k) for k in range(5)))
    decoder = UbxDecoder()
    assert decoded(decoder, ubx_epoch(0), dirt, *(ubx_epoch(k) for k in range(1, 5))) == clean
    assert decoder.skipped == {reason: 1}


def test_messages_that_say_nothing_of_the_fix_are_passed_over() -> None:
    decoder = UbxDecoder()
    assert len(decoded(decoder, frame(b"\x01\x35", b"\x00" * 8) + pvt() + frame(b"\x77\x01", b""))) == 1
    assert decoder.skipped == {}


def test_frames_behind_half_a_frame_at_the_end_are_found() -> None:
    decoder = UbxDecoder()
    assert len(decoded(decoder, frame(b"\x01\x35", b"\x00" * 400)[:40] + ubx_epoch(0))) == 1
    assert decoder.skipped == {"truncated": 1}


# both ---------------------------------------------------------------------------------------------------------------------

STREAMS = {
    "nmea": (NmeaDecoder, b"".join(nmea_epoch(0.2 * k) + dirt for k, (dirt, _) in enumerate(NMEA_DIRT.values()))),
    "ubx": (UbxDecoder, b"".join(ubx_epoch(k) + dirt for k, (dirt, _) in enumerate(UBX_DIRT.values())) + ubx_epoch(20)),
}


@pytest.mark.parametrize("protocol", STREAMS)
def test_a_stream_cut_at_any_byte_gives_the_same_fixes_and_counts(protocol: str) -> None:
    kind, data = STREAMS[protocol]
    whole = kind()
    expected = decoded(whole, data)
    assert len(expected) >= 7
    bytewise = kind()
    assert decoded(bytewise, *(data[i : i + 1] for i in range(len(data)))) == expected
    assert bytewise.skipped == whole.skipped
    for cut in range(1, len(data), 7):
        halves = kind()
        assert decoded(halves, data[:cut], data[cut:]) == expected
        assert halves.skipped == whole.skipped


@given(data=st.binary(max_size=400), protocol=st.sampled_from(sorted(STREAMS)))
def test_no_bytes_make_a_decoder_fail_and_what_follows_them_is_read(data: bytes, protocol: str) -> None:
    kind, _ = STREAMS[protocol]
    epoch = nmea_epoch if protocol == "nmea" else ubx_epoch
    told = decoded(kind(), data, b"\r\n", *(epoch(k) for k in range(30, 60)))
    assert NOON + 59 in [fix.utc_s for fix in told]


# sources ------------------------------------------------------------------------------------------------------------------


def write(folder: Path, protocol: str, count: int = 6) -> ReceiverOptions:
    path = folder / f"log.{protocol}"
    path.write_bytes(b"".join((nmea_epoch if protocol == "nmea" else ubx_epoch)(k) for k in range(count)))
    return options(protocol=protocol, file=str(path))


def options(**given: object) -> ReceiverOptions:
    return ReceiverOptions.model_validate(given)


def times(source: object, until_s: float = math.inf) -> list[float]:
    told = []
    while (ready := source.next_s()) is not None and ready <= until_s:  # type: ignore[attr-defined]
        measured = source.read()  # type: ignore[attr-defined]
        if measured is not None:
            told.append(measured.measured_s)
    return told


@pytest.mark.parametrize("protocol", ["nmea", "ubx"])
def test_a_file_is_replayed_at_its_own_pace_from_its_first_fix_or_a_stated_time(tmp_path: Path, protocol: str) -> None:
    given = write(tmp_path, protocol)
    assert times(open_receiver(given, 0.0)) == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    assert times(open_receiver(given, 2.5)) == [3.0, 4.0, 5.0]
    later = given.model_copy(update={"zero_at": "2022-02-25T12:00:01.500Z"})
    assert times(open_receiver(later, 0.0)) == [0.5, 1.5, 2.5, 3.5]


def test_a_time_that_goes_back_in_a_file_is_skipped(tmp_path: Path) -> None:
    path = tmp_path / "log.ubx"
    path.write_bytes(b"".join(pvt(k) for k in (0, 1, 2, 1, 3)))
    source = open_receiver(options(protocol="ubx", file=str(path)), 0.0)
    assert times(source) == [0.0, 1.0, 2.0, 3.0]
    assert source.skipped == {"out_of_order": 1}  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    "wrong",
    [
        {"protocol": "nmea"},
        {"protocol": "nmea", "file": "a", "tcp": "h:1"},
        {"protocol": "rtcm", "file": "a"},
        {"protocol": "nmea", "tcp": "nowhere"},
        {"protocol": "nmea", "tcp": "here:65536"},
        {"protocol": "nmea", "serial": "/dev/ttyUSB0", "baud": 0},
        {"protocol": "nmea", "file": "a", "zero_at": "yesterday"},
    ],
)
def test_a_receiver_that_cannot_be_is_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=r"receiver|protocol|tcp|baud|one of|isoformat"):
        options(**wrong)


def until(source: LiveReceiver, condition: object, polls: int = 5000) -> list[float]:
    """Poll until a condition holds; `select` on nothing gives the kernel its moment."""
    told: list[float] = []
    for _ in range(polls):
        measured = source.read()
        if measured is not None:
            told.append(measured.measured_s)
        if condition(told):  # type: ignore[operator]
            return told
        select.select([], [], [], 0.0005)
    raise AssertionError(f"never: {told}, {source.skipped}")


def test_a_receiver_is_heard_over_tcp_and_again_after_the_connection_was_lost() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        source = open_receiver(options(protocol="nmea", tcp=f"127.0.0.1:{server.getsockname()[1]}"), NOON)
        assert isinstance(source, LiveReceiver)
        assert source.read() is None
        first, _ = server.accept()
        with first:
            first.sendall(nmea_epoch(0.0) + nmea_epoch(1.0) + gga(2.0)[:20])
            assert until(source, lambda told: len(told) == 2) == [NOON, NOON + 1.0]
        until(source, lambda told: source.skipped.get("disconnected"))
        for _ in range(RETRY_POLLS + 1):
            assert source.read() is None
        second, _ = server.accept()
        with second:
            second.sendall(nmea_epoch(3.0))
            assert until(source, lambda told: told) == [NOON + 3.0]
    assert source.skipped == {"disconnected": 1, "truncated": 1}


def test_a_receiver_that_is_not_there_is_tried_again_and_again_without_waiting() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        port = server.getsockname()[1]
    source = LiveReceiver(TcpStream(f"127.0.0.1:{port}"), NmeaDecoder(), 0.0)
    until(source, lambda told: source.skipped.get("disconnected", 0) >= 3)


def test_a_live_receiver_looks_every_10_milliseconds_and_tells_what_waits_at_once() -> None:
    class Said:
        def __init__(self) -> None:
            self.bytes = [b"", b"".join(ubx_epoch(k) for k in range(4)), b""]

        def read(self) -> bytes:
            return self.bytes.pop(0) if self.bytes else b""

        def close(self) -> None: ...

    source = LiveReceiver(Said(), UbxDecoder(), 100.0)
    assert source.next_s() == 100.0
    assert source.read() is None
    assert source.next_s() == 100.0 + POLL_S
    assert [source.read().measured_s for _ in range(4)] == [NOON + k for k in range(4)]  # type: ignore[union-attr]
    assert source.next_s() == pytest.approx(100.0 + 2 * POLL_S)


@pytest.mark.parametrize(("library", "protocol"), [("pynmeagps", "nmea"), ("pyubx2", "ubx"), ("serial", "nmea")])
def test_a_library_that_is_missing_is_named_before_anything_is_opened(
    monkeypatch: pytest.MonkeyPatch, library: str, protocol: str
) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(ValueError, match=rf"{library}.*milepost\[receivers\]"):
        open_receiver(options(protocol=protocol, serial="/dev/null"), 0.0)


def test_a_receiver_is_heard_on_a_serial_device() -> None:
    pytest.importorskip("serial", reason="needs the extra `receivers`")
    ours, theirs = os.openpty()
    try:
        source = open_receiver(options(protocol="ubx", serial=os.ttyname(theirs), baud=38400), NOON)
        assert isinstance(source, LiveReceiver)
        source.read()
        os.write(ours, ubx_epoch(0) + ubx_epoch(1))
        assert until(source, lambda told: len(told) == 2) == [NOON, NOON + 1]
    finally:
        os.close(ours)
        os.close(theirs)
