"""Registers the Gymnasium environments: `gymnasium.make("readygo.gym:ReadyGo/PointNav-v0", scene="embedded")`.

`ReadyGo/StateNav-v0` tells robots states instead of images.

Gymnasium imports the module before the colon; after `import readygo.gym` the name without it works too. The prefix
`readygo:` works as well.
"""

from readygo.apps.gym import registration as registration
