"""Images from Gaussians."""
