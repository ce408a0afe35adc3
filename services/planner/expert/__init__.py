"""The robot expert: what it knows, what it expects, how it plans and drives."""
