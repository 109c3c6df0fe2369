"""The trains as a GTFS-Realtime feed of vehicle positions."""

from __future__ import annotations

from collections.abc import Iterable

from google.transit import gtfs_realtime_pb2

from milepost_schemas import FusedState

from .fleet import NS_PER_S

VERSION = "2.0"
# the format cannot say how uncertain a position is: what is only guessed is left out
NOT_KNOWN = ("initialising", "lost")


def vehicle_positions(states: Iterable[FusedState], now_ns: int) -> bytes:
    """All trains whose place on earth is known, whole (FULL_DATASET); fields that the state does not have are left out."""
    feed = gtfs_realtime_pb2.FeedMessage()
    feed.header.gtfs_realtime_version = VERSION
    feed.header.incrementality = gtfs_realtime_pb2.FeedHeader.FULL_DATASET
    feed.header.timestamp = now_ns // NS_PER_S
    for state in states:
        if state.latitude_deg is None or state.longitude_deg is None or state.status in NOT_KNOWN:
            continue
        entity = feed.entity.add()
        entity.id = state.train
        vehicle = entity.vehicle
        vehicle.vehicle.id = vehicle.vehicle.label = state.train
        vehicle.position.latitude = state.latitude_deg
        vehicle.position.longitude = state.longitude_deg
        vehicle.position.speed = abs(state.speed_mps)
        vehicle.timestamp = state.measured_at_ns // NS_PER_S
    return bytes(feed.SerializeToString())
