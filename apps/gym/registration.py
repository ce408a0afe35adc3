"""Tells Gymnasium of the environments; an installed readygo does that by itself."""

ENVIRONMENT = "ReadyGo/PointNav-v0"


def register() -> None:
    """Make `gymnasium.make("ReadyGo/PointNav-v0")` work; a second time changes nothing."""
    import gymnasium

    if ENVIRONMENT not in gymnasium.registry:
        gymnasium.register(
            id=ENVIRONMENT,
            entry_point="readygo.apps.gym.env:PointNavEnv",
            vector_entry_point="readygo.apps.gym.vector:PointNavVectorEnv",
        )
