"""A recording for Foxglove: every message as JSON with its JSON Schema, and the place of each state on a map.

`foxglove.LocationFix` is one of Foxglove's own schemas, known to its map panel by name:
https://docs.foxglove.dev/docs/visualization/message-schemas/location-fix
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import CompressionType, Writer

from milepost_schemas import FusedState, Message, Stream
from milepost_schemas.documents import json_schema_text, schema_name

LOCATION = "foxglove.LocationFix"
# COVARIANCE_TYPE_APPROXIMATED
APPROXIMATED = 1
NS_PER_S = 1_000_000_000
_NUMBER = {"type": "number"}
_TIME = {"type": "object", "title": "time", "properties": {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}}
LOCATION_SCHEMA = {
    "title": LOCATION,
    "description": "A navigation satellite fix for any Global Navigation Satellite System",
    "type": "object",
    "properties": {
        "timestamp": _TIME,
        "frame_id": {"type": "string"},
        "latitude": _NUMBER,
        "longitude": _NUMBER,
        "altitude": _NUMBER,
        "position_covariance": {"type": "array", "items": _NUMBER, "minItems": 9, "maxItems": 9},
        "position_covariance_type": {"type": "integer", "title": "PositionCovarianceType"},
    },
}


class FoxgloveFile:
    """An MCAP file that Foxglove shows without a plug-in."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("wb")
        self._writer: Any = Writer(self._file, compression=CompressionType.ZSTD)
        self._writer.start("")
        self._schemas: dict[str, int] = {}
        self._channels: dict[str, int] = {}
        self.written = [path]

    def add(self, row: Stream, message: Message, fields: dict[str, Any], at_ns: int) -> None:
        """Append a message; after a state with a place on the globe, that place. Raises OSError."""
        del fields
        topic = "/" + row.key_for(message.train, message.unit)
        name = f"milepost.{row.message.SCHEMA}"
        schema = json_schema_text(schema_name(row.message))
        self._write(topic, name, schema, message.model_dump_json(), message, at_ns)
        if isinstance(message, FusedState) and message.latitude_deg is not None and message.longitude_deg is not None:
            fix = json.dumps(location(message))
            self._write(f"/{row.key_for(message.train)}/location", LOCATION, json.dumps(LOCATION_SCHEMA), fix, message, at_ns)

    def _write(self, topic: str, name: str, schema: str, data: str, message: Message, at_ns: int) -> None:
        if name not in self._schemas:
            self._schemas[name] = self._writer.register_schema(name, SchemaEncoding.JSONSchema, schema.encode())
        if topic not in self._channels:
            self._channels[topic] = self._writer.register_channel(topic, MessageEncoding.JSON, self._schemas[name])
        self._writer.add_message(
            self._channels[topic], at_ns, data.encode(), message.published_at_ns, message.sequence & 0xFFFF_FFFF
        )

    def close(self) -> None:
        """Finish the file."""
        self._writer.finish()
        self._file.close()


def location(state: FusedState) -> dict[str, Any]:
    """A state as a `foxglove.LocationFix`; the variance along the track stands for both horizontal directions."""
    seconds, nanoseconds = divmod(state.measured_at_ns, NS_PER_S)
    variance = state.covariance[0][0]
    return {
        "timestamp": {"sec": seconds, "nsec": nanoseconds},
        "frame_id": state.train,
        "latitude": state.latitude_deg,
        "longitude": state.longitude_deg,
        "altitude": 0.0,
        "position_covariance": [variance, 0.0, 0.0, 0.0, variance, 0.0, 0.0, 0.0, 0.0],
        "position_covariance_type": APPROXIMATED,
    }
