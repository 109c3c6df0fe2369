"""A sensor's noise, learned from its readings: adaptive variances, time-varying noise, pre-filters."""
