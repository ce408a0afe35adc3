"""Cost and learning of the policy in toy rooms."""
