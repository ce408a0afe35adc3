"""Speed and exactness of drawing."""
