"""A Zenoh session: what its configuration file says, where it leads, whether it still hears."""
