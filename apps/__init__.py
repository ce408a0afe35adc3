"""What ties the services together: the `readygo` command, the local fleet and the demo."""
