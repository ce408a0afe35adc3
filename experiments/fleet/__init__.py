"""Models of large fleets."""
