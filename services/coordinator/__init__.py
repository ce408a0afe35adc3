"""The coordinator: owns a run's ledger."""
