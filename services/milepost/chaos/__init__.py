"""The chaos suite: a running train is broken on purpose, and what an outsider sees of it is measured."""
