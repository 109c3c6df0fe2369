"""The fuser's mathematics: the rules of fusion, the shares, and the bank of hypotheses. No clock, no I/O, no Zenoh."""
