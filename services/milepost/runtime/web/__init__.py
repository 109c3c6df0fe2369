"""The web server for machines that do not speak Zenoh."""
