"""Line, train and scenario files that are written from a log."""
