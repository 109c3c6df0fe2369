"""Train, line, scenario and motion files are read and checked here, and made into objects."""
