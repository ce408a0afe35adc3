"""What a camera's lens, shutter and sensor do to an image."""
