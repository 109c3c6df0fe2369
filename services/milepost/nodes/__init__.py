"""One file for each kind of process. A node turns messages into messages and takes the time as an argument."""
