"""What machines read of the trains on a router: metrics, vehicle positions, GeoJSON. Messages in, documents out."""
