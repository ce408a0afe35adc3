"""Speed and quality on this machine, next to a peer or a bound."""
