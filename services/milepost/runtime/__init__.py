"""The only room that knows Zenoh, clocks, signals and the environment. It knows no mathematics."""
