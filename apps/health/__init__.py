"""The health report of a scene: what it holds, where its numbers come from, and what is wrong with it."""
