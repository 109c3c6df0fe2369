"""The centralised filter: all observations at once, sorted, one pass. What every other result is measured against."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import numpy as np

from .estimator import Prior
from .kalman import predict, update
from .layout import Array, Layout
from .motion import full_process_noise, full_transition
from .timeline import NS, Observation


def centralised(
    observations: Iterable[Observation],
    epochs_ns: Iterable[int],
    layout: Layout,
    jerk_psd: float,
    prior: Prior,
    begins_ns: int | None = None,
) -> Iterator[tuple[int, Array, Array]]:
    """The optimal estimate at each epoch: (epoch, mean (n), covariance (n, n)), from all observations until then.

    The prior sits at the earliest observation, or at `begins_ns` before it. Epochs before it are passed over.
    """
    ordered = sorted(observations, key=lambda o: o[:5])
    if not ordered:
        return
    x, P = layout.prior(prior.mean, prior.std)
    at, place = ordered[0].measured_at_ns if begins_ns is None else begins_ns, 0
    for epoch in sorted(epochs_ns):
        if epoch < at:
            continue
        while place < len(ordered) and ordered[place].measured_at_ns <= epoch:
            o = ordered[place]
            x, P = _carry(x, P, (o.measured_at_ns - at) * NS, layout, jerk_psd)
            x, P = update(x, P, _row(o, layout), o.value, o.variance)
            at = o.measured_at_ns
            place += 1
        yield epoch, *_carry(x, P, (epoch - at) * NS, layout, jerk_psd)


def _carry(x: Array, P: Array, dt_s: float, layout: Layout, jerk_psd: float) -> tuple[Array, Array]:
    if dt_s <= 0.0:
        return x, P
    return predict(x, P, full_transition(dt_s, layout), full_process_noise(dt_s, jerk_psd, layout))


def _row(observation: Observation, layout: Layout) -> Array:
    return np.array(layout.lift(observation.unit, observation.row))
