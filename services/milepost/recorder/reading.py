"""Reads MCAP files, also those that were cut off or have a damaged part: what is there and whole is read."""

from __future__ import annotations

import contextlib
import re
import struct
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import IO, Any

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, Message, Metadata, Schema
from mcap.stream_reader import breakup_chunk
from mcap.summary import Summary

from milepost.config.errors import ConfigError

from .file import ENCODING
from .incoming import Incoming
from .records import MAGIC, Span, index_of, spans
from .rows import MSGPACK
from .window import ALL, Window

SUFFIX = ".mcap"
# as `Recorder` names its files: the train, when it was begun, a number
NAMED = re.compile(r"(.+)-\d{8}T\d{6}Z-\d+")
# no recorder makes larger ones; a damaged length must not take all memory
MOST_CHUNK_BYTES = 1 << 30
# what the library raises on bytes that are none of its
DAMAGED = (McapError, zstandard.ZstdError, struct.error, ValueError, KeyError, IndexError, OverflowError)


def recordings_in(path: Path) -> list[Path]:
    """A file, or all MCAP files of a folder by name, which is by time. Raises ConfigError."""
    if path.is_dir():
        inside = sorted(each for each in path.iterdir() if each.suffix == SUFFIX)
        if not inside:
            raise ConfigError(path, "", f"has no {SUFFIX} files")
        return inside
    if not path.is_file():
        raise ConfigError(path, "", "no such file")
    return [path]


def following(files: Iterable[Path]) -> list[list[Path]]:
    """Files in groups of those that follow one another, in their order: the recording of a train, by the names of its files."""
    groups: dict[str, list[Path]] = {}
    for path in files:
        named = NAMED.fullmatch(path.stem)
        groups.setdefault(str(path.parent / named[1]) if named else str(path), []).append(path)
    return list(groups.values())


@dataclass
class McapReader:
    """Reads one file, or a `window` of it, in the order in which it was written.

    `whole`: it has its end and index; known after all has been read. `damaged`: what of it could not be read. `metadata` has
    what the recorder wrote about the recording, as far as it has been read.
    """

    path: Path
    window: Window = ALL
    whole: bool = False
    damaged: list[str] = field(default_factory=list)
    metadata: dict[str, dict[str, str]] = field(default_factory=dict)
    read_bytes: int = 0
    _schemas: dict[int, Schema] = field(default_factory=dict)
    _channels: dict[int, Channel] = field(default_factory=dict)
    _unknown: set[int] = field(default_factory=set)

    def messages(self) -> Iterator[Incoming]:
        """Every message. Raises ConfigError for what is no MCAP file."""
        try:
            with self.path.open("rb") as file:
                begins = file.read(len(MAGIC))
                # one that has not even its beginning was begun a moment ago, or its recorder was killed then
                if begins != MAGIC and MAGIC.startswith(begins):
                    return
                if begins != MAGIC and not _ends(file):
                    raise ConfigError(self.path, "", "is no MCAP file")
                yield from self._messages(file, self._read_index(file))
        except OSError as error:
            raise ConfigError(self.path, "", error.strerror or "cannot be read") from error

    @property
    def cut_off(self) -> bool:
        """Whether its end is missing and nothing else is wrong, known after all has been read."""
        return not self.whole and not self.damaged

    @property
    def flaws(self) -> list[str]:
        """What is wrong with it, in sentences, known after all has been read."""
        if self.cut_off:
            return [f"{self.path.name}: cut off: read as far as it goes"]
        return [f"{self.path.name}: damaged: {damage}" for damage in self.damaged]

    def read_metadata(self) -> dict[str, dict[str, str]]:
        """What the recorder wrote about the recording, without reading the messages."""
        with self.path.open("rb") as file:
            for span in spans(file, None, []):
                if span.opcode == Opcode.METADATA:
                    # one that cannot be read is told of where the messages are read
                    with contextlib.suppress(*DAMAGED):
                        self._note(span.opcode, _content(file, span))
        return self.metadata

    def _read_index(self, file: IO[bytes]) -> Summary | None:
        """The end of the file, where there is one; its channels: then a damaged part takes no other part's with it."""
        try:
            index = index_of(file)
        except DAMAGED as error:
            self.damaged.append(_why(error))
            return None
        if index is not None:
            self.whole = True
            self._schemas, self._channels = dict(index.schemas), dict(index.channels)
        return index

    def _messages(self, file: IO[bytes], index: Summary | None) -> Iterator[Incoming]:
        for span in spans(file, index, self.damaged):
            if span.opcode not in (Opcode.MESSAGE_INDEX, Opcode.ATTACHMENT):
                try:
                    yield from self._opened(span.opcode, _content(file, span))
                except (*DAMAGED, MemoryError) as error:
                    self.damaged.append(f"bytes {span.at} to {span.end - 1}: {_why(error)}")
            self.read_bytes = span.end
        if self.whole:
            self.read_bytes = self.path.stat().st_size

    def _opened(self, opcode: int, body: bytes) -> Iterator[Incoming]:
        if opcode != Opcode.CHUNK:
            yield from self._note(opcode, body)
            return
        chunk = Chunk.read(ReadDataStream(BytesIO(body)))
        if max(chunk.uncompressed_size, _promised(chunk)) > MOST_CHUNK_BYTES:
            raise ValueError(f"a chunk of {chunk.uncompressed_size} bytes")
        # without an index its keys may be those of later messages
        if self.whole and self.window.misses(chunk.message_start_time, chunk.message_end_time):
            return
        for record in breakup_chunk(chunk, validate_crc=True):
            yield from self._take(record)

    def _note(self, opcode: int, body: bytes) -> Iterator[Incoming]:
        stream = ReadDataStream(BytesIO(body))
        if opcode == Opcode.METADATA:
            found = Metadata.read(stream)
            self.metadata[found.name] = found.metadata
        elif opcode == Opcode.SCHEMA:
            self._take(Schema.read(stream))
        elif opcode == Opcode.CHANNEL:
            self._take(Channel.read(stream))
        elif opcode == Opcode.MESSAGE:
            return self._take(Message.read(stream, len(body)))
        return iter(())

    def _take(self, record: Any) -> Iterator[Incoming]:
        if isinstance(record, Schema):
            self._schemas[record.id] = record
        elif isinstance(record, Channel):
            self._channels[record.id] = record
        elif isinstance(record, Message) and self.window.holds(record.log_time):
            channel = self._channels.get(record.channel_id)
            if channel is None:
                if record.channel_id not in self._unknown:
                    self._unknown.add(record.channel_id)
                    self.damaged.append(f"messages of channel {record.channel_id}, whose key was in a damaged part")
                return iter(())
            return iter((Incoming(channel.topic, self._encoding(channel), record.log_time, record.data),))
        return iter(())

    def _encoding(self, channel: Channel) -> str:
        said = channel.metadata.get(ENCODING)
        schema = self._schemas.get(channel.schema_id)
        if said is not None or schema is None or channel.message_encoding != "msgpack":
            return channel.message_encoding if said is None else said
        return f"{MSGPACK};{schema.name}"


def _ends(file: IO[bytes]) -> bool:
    """Whether a file ends as one that was finished."""
    file.seek(max(0, file.seek(0, 2) - len(MAGIC)))
    return file.read() == MAGIC


def _why(error: Exception) -> str:
    return str(error) or type(error).__name__


def _content(file: IO[bytes], span: Span) -> bytes:
    file.seek(span.begin)
    return file.read(span.end - span.begin)


def _promised(chunk: Chunk) -> int:
    return zstandard.frame_content_size(chunk.data) if chunk.compression == "zstd" else 0
