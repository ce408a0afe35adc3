"""Scenarios: where the robot starts and goes, and which humans meet it on the way.

The way through: `handlers` answers a request; `sampler` draws a scenario: a `robot_task` (start, goal, the way that the
robot is expected to take), and for it an encounter of one of the `families`, by the `config` that a recipe of `mixes`
made. Routes come from `paths` (`window_search` on the map, `slopes` blocked), made smooth by `spline` over `polyline`;
`timing` says who is where when; `passages` finds doors. Or `script` plays what a `scenario_file` says. At last
`reactive` lets humans yield to the expert, one `velocity_choice` at a time.
"""
