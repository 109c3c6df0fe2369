"""Receivers that speak NMEA 0183 or UBX: live over TCP or a serial device, or from a recorded file."""

from __future__ import annotations

import socket
from collections import deque
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, Literal, Protocol

from pydantic import BaseModel, Field, model_validator

from milepost.recordings.epochs import Decoder, Fix
from milepost.recordings.measured import Measured, Source
from milepost.recordings.nmea import NmeaDecoder
from milepost.recordings.options import STRICT, DataPath
from milepost.recordings.ubx import UbxDecoder

POLL_S = 0.01
CHUNK = 4096
# more than any receiver sends in 10 ms; the rest waits for the next poll
CHUNKS_A_POLL = 4
# polls from a lost connection to the next attempt
RETRY_POLLS = 100
DECODERS: dict[str, type[Decoder]] = {"nmea": NmeaDecoder, "ubx": UbxDecoder}


class ReceiverOptions(BaseModel):
    """`protocol`, and one of `file`, `tcp` (host:port) and `serial` (a device, with its `baud`).

    `zero_at`: which UTC time of a file is scenario time 0, in ISO 8601; the first fix's where it is not given.
    """

    model_config = STRICT

    protocol: Literal["nmea", "ubx"]
    file: DataPath | None = None
    tcp: Annotated[str, Field(pattern=r"^\[?[^\s\[\]]+\]?:\d{1,5}$")] | None = None
    serial: str | None = None
    baud: Annotated[int, Field(ge=300, le=4_000_000)] = 9600
    zero_at: str | None = None

    @model_validator(mode="after")
    def _one_way_in(self) -> ReceiverOptions:
        if sum(way is not None for way in (self.file, self.tcp, self.serial)) != 1:
            raise ValueError("give one of file, tcp and serial")
        if self.zero_at is not None:
            _utc_s(self.zero_at)
        if self.tcp is not None and int(self.tcp.rpartition(":")[2]) > 65_535:
            raise ValueError(f"tcp: {self.tcp} has no such port")
        return self

    @property
    def live(self) -> bool:
        """Whether there is a device at the other end, whose stamps are the present time."""
        return self.file is None


class ByteStream(Protocol):
    """Bytes as they come; never waits."""

    def read(self) -> bytes:
        """What has come since; nothing where nothing has. Raises OSError where the connection is lost or cannot be made."""

    def close(self) -> None:
        """Close the connection; the next `read` opens a new one."""


class TcpStream:
    """A TCP connection that is made at the first read."""

    def __init__(self, address: str) -> None:
        host, _, port = address.rpartition(":")
        self._host, self._port = host.strip("[]"), int(port)
        self._socket: socket.socket | None = None

    def read(self) -> bytes:
        """What has come since."""
        if self._socket is None:
            family, kind, protocol, _, place = socket.getaddrinfo(self._host, self._port, type=socket.SOCK_STREAM)[0]
            self._socket = socket.socket(family, kind, protocol)
            self._socket.setblocking(False)
            # a peer whose cable was pulled says nothing: keep-alive ends such a connection
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
            self._socket.connect_ex(place)
            return b""
        error = self._socket.getsockopt(socket.SOL_SOCKET, socket.SO_ERROR)
        if error:
            raise OSError(error, "connection failed")
        try:
            data = self._socket.recv(CHUNK)
        except BlockingIOError:
            return b""
        if not data:
            raise ConnectionError("the other end closed the connection")
        return data

    def close(self) -> None:
        """Close the socket."""
        if self._socket is not None:
            self._socket.close()
        self._socket = None


class SerialStream:
    """A serial device that is opened at the first read."""

    def __init__(self, device: str, baud: int) -> None:
        # only trains with a serial receiver need it
        import serial

        self._open = serial.Serial
        self._device, self._baud = device, baud
        self._port: Any = None

    def read(self) -> bytes:
        """What has come since."""
        if self._port is None:
            self._port = self._open(self._device, self._baud, timeout=0)
        return bytes(self._port.read(CHUNK))

    def close(self) -> None:
        """Close the device."""
        if self._port is not None:
            self._port.close()
        self._port = None


class LiveReceiver:
    """Polls for bytes every 10 ms from `from_s` on; scenario time is UTC. A lost connection is counted and reopened."""

    def __init__(self, stream: ByteStream, decoder: Decoder, from_s: float) -> None:
        self._stream, self._decoder = stream, decoder
        self.skipped = decoder.skipped
        self._poll_s = from_s
        self._wait = 0
        self._fixes: deque[Fix] = deque()

    def next_s(self) -> float:
        """The time of the next poll, or, while fixes are waiting, of the last one."""
        return self._poll_s - POLL_S if self._fixes else self._poll_s

    def read(self) -> Measured | None:
        """The next fix, if one is complete."""
        if not self._fixes:
            self._poll()
        if not self._fixes:
            return None
        fix = self._fixes.popleft()
        return Measured(fix.utc_s, fix.fields)

    def _poll(self) -> None:
        self._poll_s += POLL_S
        if self._wait:
            self._wait -= 1
            return
        try:
            for _ in range(CHUNKS_A_POLL):
                data = self._stream.read()
                if not data:
                    break
                self._fixes.extend(self._decoder.feed(data))
        except OSError:
            self.skipped["disconnected"] = self.skipped.get("disconnected", 0) + 1
            self._stream.close()
            self._wait = RETRY_POLLS


class ReplayedReceiver:
    """The fixes of a file at their own pace; one that is not after the one before is skipped as `out_of_order`."""

    def __init__(self, path: Path, decoder: Decoder, zero_s: float | None, from_s: float) -> None:
        self.skipped = decoder.skipped
        self._fixes = self._read(path, decoder, zero_s, from_s)
        self._next: Measured | None = next(self._fixes, None)

    def _read(self, path: Path, decoder: Decoder, zero_s: float | None, from_s: float) -> Iterator[Measured]:
        last_s = -float("inf")
        for fix in _decoded(path, decoder):
            zero_s = fix.utc_s if zero_s is None else zero_s
            # the difference of two times since 1970 is good to a quarter of a microsecond
            at = round(fix.utc_s - zero_s, 6)
            if at <= last_s:
                self.skipped["out_of_order"] = self.skipped.get("out_of_order", 0) + 1
                continue
            last_s = at
            if at >= max(from_s, 0.0):
                yield Measured(at, fix.fields)

    def next_s(self) -> float | None:
        """The next fix's time."""
        return None if self._next is None else self._next.measured_s

    def read(self) -> Measured | None:
        """The next fix."""
        fix, self._next = self._next, next(self._fixes, None)
        return fix


def _decoded(path: Path, decoder: Decoder) -> Iterator[Fix]:
    with path.open("rb") as file:
        while chunk := file.read(CHUNK):
            yield from decoder.feed(chunk)
    yield from decoder.finish()


def _utc_s(text: str) -> float:
    at = datetime.fromisoformat(text)
    return (at if at.tzinfo else at.replace(tzinfo=UTC)).timestamp()


def open_receiver(options: ReceiverOptions, from_s: float) -> Source:
    """The fixes of a receiver from `from_s` on. Raises ValueError where a library of the extra `receivers` is missing."""
    try:
        decoder = DECODERS[options.protocol]()
        if options.file is not None:
            return ReplayedReceiver(options.file, decoder, _utc_s(options.zero_at) if options.zero_at else None, from_s)
        stream = TcpStream(options.tcp) if options.tcp is not None else SerialStream(options.serial or "", options.baud)
    except ImportError as error:
        raise ValueError(f"{error}: a receiver needs the extra `receivers` (pip install 'milepost[receivers]')") from error
    return LiveReceiver(stream, decoder, from_s)
