"""What a fleet survives, how fast it recovers, and what it can carry."""
