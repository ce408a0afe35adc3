"""The commands of `readygo`: read arguments, call, print."""
