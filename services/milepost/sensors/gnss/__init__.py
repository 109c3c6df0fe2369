"""Satellite receivers: fixes, their monitor, and devices that speak NMEA or UBX."""
