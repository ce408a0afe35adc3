"""Methods that know the map, and the humans where they say so: bounds and comparisons for policies that only see."""
