"""How human the gait is, and what motions cost."""
