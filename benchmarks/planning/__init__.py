"""Success and cost of scenarios, experts and maps."""
