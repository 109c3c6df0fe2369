"""The only sensor lies before its first second is over: the prediction without it goes on from when it was first heard."""

from __future__ import annotations

from banks import Ride, receiver


def test_without_the_only_sensor_the_train_has_moved_all_the_same() -> None:
    """20 m/s, heard from 13 ms on, 30 m off from 0.4 s on: the prior of ± 0.5 m is then 8 m along the line."""
    moments = list(Ride((receiver(),)).moments(3.0, {"receiver": lambda t, z, _: z - 30.0 if t > 0.4 else z}))
    without = [m for m in moments if m.excluded]
    assert without[0].t_s < 0.5
    assert all(m.holds() for m in moments)
    assert abs(float(without[0].bank.x[without[0].bank.leader, 0]) - 20.0 * (without[0].t_s - 0.013)) < 1.0
