"""One folder per service; services never import each other, they talk over the bus."""
