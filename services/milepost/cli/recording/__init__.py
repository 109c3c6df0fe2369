"""The commands for recordings: rerun, info, export, replay."""
