"""Families of encounters: each draws how one or more humans meet the robot on its way, or finds no room for it.

A draw is really what its name says, by the way and the speed that are expected of the robot (`ExpectedDrive`): what
does not fit is refused here, so that shares in the data mean what they say. `site` is what they draw on,
`along_the_way` the families that any place has room for, `places` those that need a suitable place.
"""

from readygo.services.planner.humans.families.along_the_way import (
    crossing,
    crossing_left,
    crossing_right,
    frontal,
    goalward,
    overtaking,
    parallel,
)
from readygo.services.planner.humans.families.places import blind_corner, doorway, standing_group, stop_and_go
from readygo.services.planner.humans.families.site import Draw, Encounter, Site

FAMILIES: dict[str, Draw] = {
    draw.__name__: draw
    for draw in (
        crossing,
        parallel,
        frontal,
        overtaking,
        crossing_left,
        crossing_right,
        blind_corner,
        doorway,
        standing_group,
        stop_and_go,
        goalward,
    )
}
"""The families by the names of `FamilyMix`."""

__all__ = ["FAMILIES", "Draw", "Encounter", "Site"]
