"""Recordings and the live bus: the recorder's process, and replays."""
