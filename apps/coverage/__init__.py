"""What a dataset covers, as numbers and a page."""
