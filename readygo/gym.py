"""Registers the Gymnasium environments: `gymnasium.make("readygo.gym:ReadyGo/PointNav-v0", scene="embedded")`.

`ReadyGo/StateNav-v0` tells robots states instead of images.

Gymnasium imports the module before the colon by itself; after `import readygo.gym` the name without it works too.
"""

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
