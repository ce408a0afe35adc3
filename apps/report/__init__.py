"""Report pages in HTML: of learning runs, evaluations, datasets, scenes and reconstructions."""
