"""The records of an MCAP file, one after the other; past a damaged one, on from the next chunk that the index knows.

Format: https://mcap.dev/spec
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from io import BytesIO
from typing import IO, NamedTuple

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Footer
from mcap.summary import Summary

MAGIC = b"\x89MCAP0\r\n"
HEADER = struct.Struct("<BQ")
# summary_start, summary_offset_start and summary_crc
FOOTER = HEADER.size + 20
KNOWN = frozenset(range(Opcode.HEADER, Opcode.DATA_END + 1))
# how the compression stands in a chunk's header, after two times, a size and a sum
ZSTD, ZSTD_AT = struct.pack("<I4s", 4, b"zstd"), HEADER.size + 8 + 8 + 8 + 4
SEARCHED_BYTES = 1 << 20


class Span(NamedTuple):
    """A record: its first byte, its opcode, and where its content begins and ends."""

    at: int
    opcode: int
    begin: int
    end: int


def index_of(file: IO[bytes]) -> Summary | None:
    """What stands at the end of a file that was finished; None where it was not. Raises McapError where it is damaged."""
    size = file.seek(0, 2)
    if size < 2 * len(MAGIC) + FOOTER:
        return None
    file.seek(size - len(MAGIC) - FOOTER)
    opcode, _ = HEADER.unpack(file.read(HEADER.size))
    rest = file.read()
    if opcode != Opcode.FOOTER or not rest.endswith(MAGIC):
        return None
    footer = Footer.read(ReadDataStream(BytesIO(rest)))
    if footer.summary_start == 0:
        return None
    if footer.summary_start > size:
        raise McapError("where its index begins")
    file.seek(footer.summary_start)
    # up to and with the field before the sum itself
    if footer.summary_crc and zlib.crc32(file.read(size - len(MAGIC) - 4 - file.tell())) != footer.summary_crc:
        raise McapError("its index")
    file.seek(0)
    return make_reader(file).get_summary()


def spans(file: IO[bytes], index: Summary | None, damaged: list[str]) -> Iterator[Span]:
    """Every whole record up to the end of the data; what is none is told in `damaged`.

    Where there is no index, a record that would go on beyond the end is no damage, unless a chunk comes after it: the file was
    cut off in it.
    """
    size, at = file.seek(0, 2), len(MAGIC)
    chunks = [] if index is None else index.chunk_indexes
    # the first byte and the one after the last, the next chunk at the end
    left = sorted(((each.chunk_start_offset, each.chunk_start_offset + each.chunk_length) for each in chunks), reverse=True)
    while True:
        span = _span(file, at, size)
        if left and left[-1][0] == at:
            end = left.pop()[1]
            if span is None or (span.opcode, span.end) != (Opcode.CHUNK, end):
                damaged.append(f"the header of the chunk at byte {at}, which the index has")
            span = Span(at, Opcode.CHUNK, at + HEADER.size, end)
        elif span is not None and span.opcode == Opcode.DATA_END and not left:
            return
        elif span is None or span.opcode not in KNOWN or span.opcode == Opcode.DATA_END or (left and span.end > left[-1][0]):
            further = left[-1][0] if left else _next_chunk(file, at + 1, size, size)
            until = size if further is None else further
            if at < until and (index is not None or span is not None or further is not None):
                damaged.append(f"bytes {at} to {until - 1}: no whole record")
            if further is None:
                return
            at = further
            continue
        # bytes that are cut out of a chunk make it reach into the next one
        inner = _next_chunk(file, span.begin, span.end, size) if span.opcode == Opcode.CHUNK and index is None else None
        if inner is None:
            yield span
        else:
            damaged.append(f"bytes {at} to {inner - 1}: no whole record")
        at = span.end if inner is None else inner


def _next_chunk(file: IO[bytes], from_: int, until: int, size: int) -> int | None:
    """Where a chunk begins of which nothing else tells, from a byte on and before another; None where there is none."""
    at, kept = from_, b""
    while at < until:
        file.seek(at)
        read = file.read(min(SEARCHED_BYTES, until - at))
        if not read:  # the file has become shorter
            return None
        block, begins = kept + read, at - len(kept)
        found = block.find(ZSTD)
        while found >= 0:
            chunk = begins + found - ZSTD_AT
            span = _span(file, chunk, size) if chunk >= from_ else None
            if span is not None and span.opcode == Opcode.CHUNK:
                return chunk
            found = block.find(ZSTD, found + 1)
        at, kept = begins + len(block), block[-len(ZSTD) + 1 :]
    return None


def _span(file: IO[bytes], at: int, size: int) -> Span | None:
    """The record that begins at a byte; None where it would end beyond the file."""
    if at + HEADER.size > size:
        return None
    file.seek(at)
    opcode, length = HEADER.unpack(file.read(HEADER.size))
    begin = at + HEADER.size
    return None if begin + length > size else Span(at, opcode, begin, begin + length)
