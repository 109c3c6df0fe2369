"""Odometers: the pulse device, wheel slip, and the stored calibration."""
