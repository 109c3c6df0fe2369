"""Doppler radars of one or two beams."""
