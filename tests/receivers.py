"""What receivers say: NMEA sentences and UBX frames, with their checksums."""

from __future__ import annotations

import struct
from datetime import UTC, datetime
from functools import reduce

NOON = datetime(2022, 2, 25, 12, tzinfo=UTC).timestamp()


def sentence(body: str) -> bytes:
    """A sentence with its checksum: all characters between $ and * exclusive-ored."""
    return f"${body}*{reduce(lambda total, character: total ^ ord(character), body, 0):02X}\r\n".encode()


def rmc(second: float = 0.0, hms: str = "", date: str = "250222") -> bytes:
    at = hms or f"1200{second:05.2f}"
    return sentence(f"GNRMC,{at},A,5053.55035,N,00432.36227,E,19.438,271.2,{date},,,R")


def gga(second: float = 0.0, hms: str = "", quality: int = 4, place: str = "5053.55035,N,00432.36227,E") -> bytes:
    at = hms or f"1200{second:05.2f}"
    return sentence(f"GNGGA,{at},{place},{quality},14,0.75,56.5,M,46.0,M,1.0,0000")


def gst(second: float = 0.0) -> bytes:
    return sentence(f"GNGST,1200{second:05.2f},1.0,,,,0.03,0.04,0.05")


def nmea_epoch(second: float) -> bytes:
    return rmc(second) + gga(second) + gst(second)


def frame(kind: bytes, payload: bytes) -> bytes:
    """A UBX frame; the checksum is Fletcher's over all but the sync characters."""
    body = kind + struct.pack("<H", len(payload)) + payload
    a = b = 0
    for byte in body:
        a = (a + byte) % 256
        b = (b + a) % 256
    return b"\xb5\x62" + body + bytes([a, b])


def pvt(second: int = 0, nano: int = 0, fix: int = 3, flags: int = 0x83, valid: int = 7, flags3: int = 0) -> bytes:
    """flags 0x83: fix good, differential corrections used, carrier phase fixed."""
    week_ms = 475_200_000 + 1000 * second + round(nano * 1e-6)
    date = struct.pack("<IHBBBBBBIi", week_ms, 2022, 2, 25, 12, 0, second, valid, 30, nano)
    state = struct.pack("<BBBB", fix, flags, 0, 17)
    place = struct.pack("<iiiiII", 45_393_712, 508_925_058, 102_500, 56_500, 14, 20)
    motion = struct.pack("<iiiiiIIH", 209, -9998, 0, 10_000, 27_120_000, 250, 500_000, 120)
    return frame(b"\x01\x07", date + state + place + motion + struct.pack("<HIihH", flags3, 0, 0, 0, 0))


def cov(second: int = 0, valid: int = 1) -> bytes:
    week_ms = 475_200_000 + 1000 * second
    values = [9e-4, 0.0, 0.0, 16e-4, 0.0, 25e-4, *[0.01] * 6]
    return frame(b"\x01\x36", struct.pack("<IBBB9x12f", week_ms, 0, valid, 1, *values))


def ubx_epoch(second: int) -> bytes:
    return pvt(second) + cov(second)


# what the decoders' fuzzing begins from
NMEA_LOG = b"".join(nmea_epoch(second) for second in (0.0, 0.2, 0.4))
UBX_LOG = b"".join(ubx_epoch(second) for second in (0, 1, 2))
