"""The strapdown inertial unit, and the error that it can learn."""
