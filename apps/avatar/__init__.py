"""Pictures and films of avatars."""
