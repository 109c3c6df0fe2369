"""What sensors that count pulses have in common: silence is a bound on speed, never zero."""

from __future__ import annotations

from milepost.recordings.measured import Measured

# silence longer than this says where the train is, not how fast it goes now
LONGEST_BOUND_S = 4.0
# the least bound that a reading can state
LEAST_BOUND_MPS = 1e-3


class Silence:
    """How long no pulse came: worth a bound after a whole period, and again each time it has doubled."""

    def __init__(self, since_s: float, period_s: float) -> None:
        self._period_s = period_s
        self.broken(since_s)

    def broken(self, at_s: float) -> None:
        """A pulse came."""
        self._since_s, self._bound_after_s = at_s, self._period_s

    def bound(self, t_s: float, pitch_m: float) -> Measured | None:
        """|v| < p/Δt, true at the middle of the silence Δt; None where that is no news."""
        silent = t_s - self._since_s
        if not self._bound_after_s <= silent <= LONGEST_BOUND_S:
            return None
        # said each time the silence has doubled: each bound is then news, not the last one again
        self._bound_after_s = 2.0 * silent
        bound = max(pitch_m / silent, LEAST_BOUND_MPS)
        return Measured(t_s - 0.5 * silent, {"speed_max_mps": bound, "interval_s": silent})
