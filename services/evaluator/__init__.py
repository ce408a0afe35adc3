"""The evaluator: closed-loop success rates."""
