"""The trainer: policies from shards."""
