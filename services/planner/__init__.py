"""The planners: where humans walk and how the expert drives."""
