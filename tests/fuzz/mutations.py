"""Valid inputs altered a little: by bytes, or inside their form, so that what is altered gets past checksums and brackets."""

from __future__ import annotations

import json
from collections.abc import Callable
from functools import reduce
from random import Random
from typing import Any

import msgpack
import yaml

from receivers import frame

INTERESTING: tuple[Any, ...] = (
    None, True, False, 0, 1, -1, 2**31, 2**63 - 1, 2**63, -(2**63), 0.0, -0.0, 1.0, 1e-320, 1e308, -1e308, 1e15, 5e-13,
    float("nan"), float("inf"), float("-inf"), "", "x", "*", "/", "é\u2028", "a" * 300, b"\xff", [], {}, [[]], [1.0], {"a": 1},
    [[1.0, 0.0], [0.0, 1.0]], "normal", "1e400", "2022-02-25T12:00:00Z", "../line.yaml", "2022-13-45", [0, 0, 0],
)  # fmt: skip
LONGEST = 4096
TOKENS = (b"0", b"9", b"-", b".", b",", b"*", b"$", b"\n", b"\r", b'"', b"nan", b"inf", b"1e999", b"\x00", b"\xff", b"\xb5\x62")


def mutated(data: bytes, form: str, random: Random) -> bytes:
    """The input with one to four changes; mostly inside its form, if it still has one."""
    if form in FORMS and random.random() < 0.7:
        try:
            return FORMS[form](data, random)[:LONGEST]
        except Exception:  # no longer of this form: then by bytes
            pass
    for _ in range(random.randint(1, 4)):
        data = in_bytes(data, random)
    return data[:LONGEST]


def in_bytes(data: bytes, random: Random) -> bytes:
    """One change of bytes: flipped, cut out, repeated, or a token put in."""
    place, length = random.randint(0, len(data)), random.randint(1, 16)
    kind = random.randrange(5)
    if kind == 0 and data:
        place = min(place, len(data) - 1)
        return data[:place] + bytes([data[place] ^ 1 << random.randrange(8)]) + data[place + 1 :]
    if kind == 1:
        return data[:place] + data[place + length :]
    if kind == 2:
        return data[:place] + data[place : place + length] * random.randint(2, 8) + data[place + length :]
    if kind == 3:
        return data[:place] + random.choice(TOKENS) + data[place + random.randint(0, 1) :]
    return data[:place] + random.randbytes(length) + data[place:]


def in_content(content: Any, random: Random) -> Any:
    """A value somewhere inside replaced, removed or nested; what is not on the way to it is shared."""
    if isinstance(content, dict) and content and random.random() < 0.85:
        key = random.choice(list(content))
        if random.random() < 0.1:
            return {name: value for name, value in content.items() if name != key}
        return {**content, key: in_content(content[key], random)}
    if isinstance(content, list) and content and random.random() < 0.85:
        place, kind = random.randrange(len(content)), random.randrange(8)
        inside = [content[place]] * (0 if kind == 0 else 2) if kind < 2 else [in_content(content[place], random)]
        return content[:place] + inside + content[place + 1 :]
    if isinstance(content, float) and random.random() < 0.5:
        return content * random.choice((-1.0, 1e-6, 0.5, 2.0, 1e6, 1e300))
    if random.random() < 0.05:
        return reduce(lambda inner, _: [inner], range(random.choice((3, 400))), content)
    return random.choice(INTERESTING)


def _msgpack(data: bytes, random: Random) -> bytes:
    changed: bytes = msgpack.packb(in_content(msgpack.unpackb(data, strict_map_key=False), random))
    return changed


def _json(data: bytes, random: Random) -> bytes:
    return json.dumps(in_content(json.loads(data), random), default=str).encode()


def _json_lines(data: bytes, random: Random) -> bytes:
    lines = data.split(b"\n")
    place = random.randrange(len(lines))
    lines[place] = _json(lines[place], random)
    return b"\n".join(lines)


def _yaml(data: bytes, random: Random) -> bytes:
    return yaml.safe_dump(in_content(yaml.safe_load(data), random), sort_keys=False).encode()


def _nmea(data: bytes, random: Random) -> bytes:
    """A change inside one sentence, whose checksum is right again."""
    lines = data.split(b"\r\n")
    place = random.randrange(len(lines))
    fields = lines[place].lstrip(b"$").rpartition(b"*")[0].split(b",")
    field = random.randrange(len(fields))
    fields[field] = random.choice((b"", *TOKENS, fields[field] * 2, in_bytes(fields[field], random)))
    body = b",".join(fields)
    lines[place] = b"$" + body + b"*%02X" % reduce(lambda total, byte: total ^ byte, body, 0)
    return b"\r\n".join(lines)


def _ubx(data: bytes, random: Random) -> bytes:
    """A change inside one frame, whose checksum is right again."""
    frames = data.split(b"\xb5\x62")[1:]
    place = random.randrange(len(frames))
    body = frames[place]
    payload = body[4:-2]
    for _ in range(random.randint(1, 3)):
        at = random.randrange(len(payload))
        size = random.choice((1, 2, 4))
        payload = payload[:at] + random.choice((b"\x00" * size, b"\xff" * size, random.randbytes(size))) + payload[at + size :]
    if random.random() < 0.1:
        payload = payload[: random.randrange(len(payload))]
    frames[place] = frame(body[:2], payload)[2:]
    return b"".join(b"\xb5\x62" + each for each in frames)


Change = Callable[[bytes, Random], bytes]
FORMS: dict[str, Change] = {
    "msgpack": _msgpack,
    "json": _json,
    "json-lines": _json_lines,
    "yaml": _yaml,
    "nmea": _nmea,
    "ubx": _ubx,
}
