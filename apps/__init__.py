"""Applications on top of the services: the `readygo` command, the local fleet and the demo."""
