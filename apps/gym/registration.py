"""Registers the Gymnasium environments when it is imported."""

import gymnasium

gymnasium.register(
    id="ReadyGo/PointNav-v0",
    entry_point="readygo.apps.gym.env:PointNavEnv",
    vector_entry_point="readygo.apps.gym.vector:PointNavVectorEnv",
)
gymnasium.register(
    id="ReadyGo/StateNav-v0",
    entry_point="readygo.apps.gym.state_nav:StateNavEnv",
    vector_entry_point="readygo.apps.gym.state_nav:StateNavVectorEnv",
)
