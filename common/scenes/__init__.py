"""Scene bundles: a folder with a Gaussian scene, its maps and its metadata."""
