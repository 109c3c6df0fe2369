"""Commands to the sensors and fusers of running trains."""
