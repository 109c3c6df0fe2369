"""How noisy a sensor is, learned from its readings: adaptive variances, noise that wanders, pre-filters."""
