"""`milepost import`."""
