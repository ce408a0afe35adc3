"""The recorder: durable shards."""
