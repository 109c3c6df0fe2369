"""Pure mathematics: no clock, no I/O, no logging, no Zenoh. README.md is the symbol sheet."""
