"""The cross-induction loop along the track, and the antennas that cross it."""
