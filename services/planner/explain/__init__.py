"""One episode in pictures: what the expert saw, expected and intended."""
