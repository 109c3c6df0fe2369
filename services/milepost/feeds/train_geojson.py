"""The trains as GeoJSON (RFC 7946): where each is, and the stretch of line that holds it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from datetime import UTC, datetime
from typing import Any

from milepost.track.track import Track
from milepost_schemas import FusedState

from .fleet import NS_PER_S

Feature = dict[str, Any]
# the track of a line, by its name and content hash; None where it is not known or has no geometry
Tracks = Callable[[str, str], Track | None]
# 1 cm
DECIMALS = 7


def train_geojson(states: Iterable[FusedState], tracks: Tracks) -> dict[str, Any]:
    """A collection of features: a point for each train and, where the line's geometry is known, its interval as a line."""
    features = [each for state in states for each in _features(state, tracks(state.line, state.line_hash))]
    return {"type": "FeatureCollection", "features": features}


def _features(state: FusedState, track: Track | None) -> Iterator[Feature]:
    point = None
    if state.latitude_deg is not None and state.longitude_deg is not None:
        point = {"type": "Point", "coordinates": _position(state.latitude_deg, state.longitude_deg)}
    yield _feature(state.train, point, {"feature": "train", **_properties(state)})
    stretch = [] if track is None else track.stretch(state.position_min_m, state.position_max_m)
    if stretch:
        line = {"type": "LineString", "coordinates": [_position(*each) for each in stretch]}
        bounds = {name: getattr(state, name) for name in ("position_min_m", "position_max_m")}
        yield _feature(f"{state.train}/interval", line, {"feature": "interval", "train": state.train, **bounds})


def _feature(name: str, geometry: dict[str, Any] | None, properties: dict[str, Any]) -> Feature:
    return {"type": "Feature", "id": name, "geometry": geometry, "properties": properties}


def _position(latitude_deg: float, longitude_deg: float) -> list[float]:
    # the standard's order
    return [round(longitude_deg, DECIMALS), round(latitude_deg, DECIMALS)]


def _properties(state: FusedState) -> dict[str, Any]:
    numbers = (
        "position_m",
        "position_min_m",
        "position_max_m",
        "position_accuracy_m",
        "speed_mps",
        "speed_min_mps",
        "speed_max_mps",
        "speed_accuracy_mps",
        "acceleration_mps2",
        "direction",
        "status",
        "line",
    )
    return {
        "train": state.train,
        "measured_at": datetime.fromtimestamp(state.measured_at_ns / NS_PER_S, UTC).isoformat(timespec="milliseconds"),
        **{name: getattr(state, name) for name in numbers},
        "excluded": [each.unit for each in state.excluded],
    }
