"""The robot expert: what it knows, what it expects, how it plans and drives.

The way through: `handlers` drives an expert (`interface`) by its `config` through an episode: `paper` or `spacetime`.
Both know the `ground` (in `cost_factors`) and the humans of `perception`, whose motion `prediction` predicts. `paper`
searches with `hybrid_astar` and follows its plan by `tracking`; `spacetime` searches with `spacetime_search` over
`timed_primitives`, whose `primitive_cost` counts walls and humans and whose heuristic is the `delay` by humans, on
`search_memory`. `rollouts` try commands ahead; `records` are what compiled functions are handed. `clearance` measures
how near a run came to bodies.
"""
