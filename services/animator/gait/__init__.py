"""The parametric gait."""
