"""Wheels that count their turning: the device, slip, and the calibration that is kept."""
