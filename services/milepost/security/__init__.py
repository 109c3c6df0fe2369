"""Certificates of a train's processes, and what each of them may send and receive."""
