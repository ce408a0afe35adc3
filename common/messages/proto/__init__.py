"""Schemas of the messages in shards; readygo.proto says how to regenerate the Python modules."""
