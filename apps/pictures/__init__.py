"""Films and overlays of recorded and planned episodes."""
