"""Training of the network that perceives people and free space in a robot's images."""
