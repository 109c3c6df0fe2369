"""One MCAP file that grows: messages exactly as they were sent, in chunks, compressed and indexed.

topic                the key
message encoding     `msgpack`; the whole encoding is in the channel's metadata
schema               the row's JSON Schema, under the name and version of its encoding
log time             the receipt, UTC;  publish time: the message's own `published_at_ns`, where it has one
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import CompressionType, Writer

from milepost_schemas import Stream
from milepost_schemas.documents import json_schema_text, schema_name

from .incoming import Head, Incoming
from .rows import MSGPACK, row_of

PROFILE = "milepost"
CHUNK_BYTES = 1 << 20
# MCAP has 65 535 in a file; a stranger who invents keys must not use them up
MOST_CHANNELS = 4096
ENCODING = "encoding"


class TooManyKeys(ValueError):
    """A file holds no more keys."""


class RecordingFile:
    """A new file. What was added before the last `flush` can be read whatever happens to the process afterwards.

    What was there at the last `sync` is there whatever happens to the machine.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.unflushed = 0
        self._kept = False
        self._file = path.open("xb")
        # the library's stubs leave half of its methods untyped
        self._writer: Any = Writer(self._file, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
        self._writer.start(PROFILE)
        self._channels: dict[tuple[str, str], int] = {}
        self._schemas: dict[str, int] = {}

    @property
    def size(self) -> int:
        """Bytes written so far."""
        return self._file.tell()

    def describe(self, name: str, facts: Mapping[str, str]) -> None:
        """Write metadata."""
        self._writer.add_metadata(name, dict(facts))

    def add(self, message: Incoming, head: Head) -> None:
        """Append one message. Raises OSError, and TooManyKeys where its key is one too many."""
        channel = self._channels.get((message.key, message.encoding)) or self._register(message.key, message.encoding)
        published_ns = message.at_ns if head.published_ns is None else head.published_ns
        # MCAP counts in 32 bits; the payload has the whole number
        self._writer.add_message(channel, message.at_ns, message.payload, published_ns, head.sequence & 0xFFFF_FFFF)
        self.unflushed += 1

    def flush(self) -> None:
        """Finish the chunk, and hand it to the system. Raises OSError."""
        self._hand_over()
        self.unflushed, self._kept = 0, True

    def sync(self) -> None:
        """The same, and wait until the disk has taken it. Raises OSError."""
        self._hand_over()
        os.fdatasync(self._file.fileno())
        self.unflushed, self._kept = 0, True

    def _hand_over(self) -> None:
        self._writer.flush()
        self._file.flush()

    def close(self) -> None:
        """Finish the file with its index. Raises OSError."""
        try:
            self._writer.finish()
            self._file.flush()
            os.fsync(self._file.fileno())
            self.unflushed, self._kept = 0, True
        finally:
            self.abandon()

    def abandon(self) -> None:
        """Close a file that can be written no more, as it is; one to which nothing was ever written goes."""
        # closing writes what the buffer holds, which may fail as well; it is closed all the same
        with contextlib.suppress(OSError):
            self._file.close()
        if not self._kept:
            self.path.unlink(missing_ok=True)

    def _register(self, key: str, encoding: str) -> int:
        if len(self._channels) >= MOST_CHANNELS:
            raise TooManyKeys(f"more than {MOST_CHANNELS} keys in a file")
        row = row_of(key, encoding)
        kind = MessageEncoding.MessagePack if row or encoding.startswith(MSGPACK) else encoding
        schema = self._schema(row) if row else 0
        channel: int = self._writer.register_channel(key, kind, schema, {ENCODING: encoding})
        self._channels[key, encoding] = channel
        return channel

    def _schema(self, row: Stream) -> int:
        name = f"{row.message.SCHEMA}/{row.message.VERSION}"
        if name not in self._schemas:
            data = json_schema_text(schema_name(row.message)).encode()
            self._schemas[name] = self._writer.register_schema(name, SchemaEncoding.JSONSchema, data)
        return self._schemas[name]
