"""Which processes `milepost up` starts for its trains."""
