"""Train, line, scenario and motion files: read, checked, built."""
