"""One file for each kind of process. A node turns messages into messages; time comes in as an argument."""
