"""Shards: reading, indexing and validating."""
