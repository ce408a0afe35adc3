"""What stands where in the embedded flat."""

from readygo.common.scenes.embedded import decor, seating, storage
from readygo.common.scenes.embedded.plan import FLAT, NORTH_M, PENDANT_M, SOUTH_M, FloorPlan
from readygo.common.scenes.embedded.shell import facing_wall
from readygo.common.scenes.embedded.surfaces import Surfaces

OAK = (0.66, 0.48, 0.31)
DARK = (0.36, 0.25, 0.17)
WHITE = (0.92, 0.91, 0.88)


def furnish(build: Surfaces) -> None:
    """Fill all rooms."""
    _living_room(build)
    _kitchen(build)
    _hall(build)
    _bedroom(build)
    _study(build)
    hang_lamps(build, FLAT)


def hang_lamps(build: Surfaces, plan: FloorPlan) -> None:
    """The lamps below a flat's ceilings."""
    for x, y, z in plan.lamps_m:
        if z <= PENDANT_M:
            decor.pendant(build.at(x, y), z + 0.03)
        else:
            decor.ceiling_lamp(build.at(x, y))


def _on_wall(build: Surfaces, room: str, side: str, along_m: float) -> Surfaces:
    """A placement on a wall, `along_m` from its left corner."""
    wall, _ = facing_wall(build, next(r for r in FLAT.rooms if r.name == room), side)
    return wall.at(along_m, 0.0)


def _living_room(build: Surfaces) -> None:
    decor.rug(build.at(-3.0, 2.75), 2.6, 2.2, ((0.62, 0.20, 0.17), (0.90, 0.82, 0.66), (0.16, 0.22, 0.33)))
    seating.sofa(build.at(-1.55, 2.75, yaw_deg=-90), (0.33, 0.43, 0.52))
    seating.table(build.at(-3.05, 2.75), (0.62, 1.05, 0.42), OAK)
    decor.fruit_bowl(build.at(-3.05, 2.95), 0.42)
    build.at(-3.0, 2.45).box((-0.12, -0.16, 0.42), (0.12, 0.16, 0.46), 0.06, (0.75, 0.3, 0.25), solid=False)
    seating.sofa(
        build.at(-3.35, 4.62, yaw_deg=12), (0.78, 0.55, 0.24), width_m=0.92, seats=1, accent=(0.25, 0.38, 0.42)
    )
    storage.sideboard(_on_wall(build, "living room", "west", 3.25), 1.5, 0.52, DARK)
    decor.television(_on_wall(build, "living room", "west", 3.25), 0.52)
    storage.bookshelf(build.at(-4.25, 0.6, yaw_deg=180), 1.5, 1.95, WHITE)
    decor.potted_plant(build.at(-4.85, 4.42), 1.35)
    decor.floor_lamp(build.at(0.15, 4.45))
    storage.sideboard(_on_wall(build, "living room", "east", 1.25), 1.4, 0.78, OAK)
    decor.table_lamp(_on_wall(build, "living room", "east", 0.85).at(0, -0.2), 0.78)
    decor.vase(_on_wall(build, "living room", "east", 1.55).at(0, -0.2), 0.78, (0.25, 0.42, 0.50))
    decor.palm(build.at(0.22, 0.9), 1.55)
    decor.picture(_on_wall(build, "living room", "east", 1.25), 0, (1.0, 0.68), z_m=1.62)
    decor.picture(build.at(-0.35, 0.6, yaw_deg=180), 1, (0.62, 0.8))
    decor.picture(build.at(-3.17, 0.6, yaw_deg=180), 3, (0.5, 0.45))
    for begin, end in ((-4.55, -4.22), (-2.58, -2.3), (-1.78, -1.52), (-0.28, -0.02)):
        decor.curtain(build.at(0, NORTH_M), begin, end, (0.86, 0.80, 0.68))
    decor.curtain_rod(build.at(0, NORTH_M), -4.6, -2.25)
    decor.curtain_rod(build.at(0, NORTH_M), -1.83, 0.03)
    decor.radiator(build.at(-0.9, NORTH_M), 0.9)


def _kitchen(build: Surfaces) -> None:
    blue, counter = (0.36, 0.48, 0.53), build.at(1.45, NORTH_M)
    storage.kitchen_counter(counter, 3.15, blue, modules=5)
    storage.backsplash(counter, 0.0, 0.95, 1.42)
    storage.backsplash(counter, 2.35, 3.75, 1.42)
    storage.wall_cupboard(counter, 0.85, blue, modules=2)
    storage.wall_cupboard(counter.at(2.45, 0), 1.3, blue, modules=3)
    storage.sink(counter, 1.65)
    storage.oven(counter, 2.84)
    storage.fridge(build.at(1.06, NORTH_M))
    east = build.at(5.2, 4.8, yaw_deg=-90)
    storage.kitchen_counter(east, 1.6, blue, modules=2)
    decor.fruit_bowl(east.at(1.2, -0.3), 0.91)
    seating.table(build.at(2.9, 1.95), (1.5, 0.85, 0.75), OAK, seed=5)
    decor.vase(build.at(2.75, 1.95), 0.75, (0.90, 0.88, 0.82), flowers=(0.95, 0.75, 0.25))
    build.at(3.2, 1.85).tube((0, 0, 0.75), 0.09, 0.04, 0.045, 0.03, (0.85, 0.45, 0.3))
    for x, y, yaw in ((2.5, 2.47, 0), (3.3, 2.44, 8), (2.5, 1.44, 180), (3.38, 1.36, 165)):
        seating.chair(build.at(x, y, yaw_deg=yaw), (0.82, 0.66, 0.45), padded=(0.72, 0.30, 0.24))
    decor.potted_plant(build.at(4.8, 1.0), 1.1, pot=(0.35, 0.45, 0.55))
    storage.sideboard(_on_wall(build, "kitchen", "west", 2.75), 1.1, 0.85, WHITE)
    decor.table_lamp(_on_wall(build, "kitchen", "west", 2.5).at(0, -0.2), 0.85)
    decor.picture(_on_wall(build, "kitchen", "west", 2.85), 3, (0.7, 0.7), z_m=1.55)
    decor.picture(build.at(1.9, 0.6, yaw_deg=180), 4, (0.9, 0.6))
    decor.rug(build.at(3.05, 3.75), 1.5, 0.6, ((0.84, 0.74, 0.52), (0.30, 0.45, 0.42), (0.78, 0.40, 0.28)), cell_m=0.06)


def _hall(build: Surfaces) -> None:
    decor.rug(
        build.at(-0.6, -0.32), 5.4, 0.78, ((0.20, 0.30, 0.36), (0.83, 0.74, 0.58), (0.62, 0.24, 0.18)), cell_m=0.065
    )
    decor.front_door(build.at(-4.55, -1.1, yaw_deg=180))
    seating.bench(build.at(-4.1, 0.5), OAK, width_m=1.0)
    decor.coat_rack(build.at(-4.1, 0.5))
    console = build.at(1.2, 0.5)
    seating.table(console.at(0, -0.17), (1.1, 0.30, 0.78), DARK, leg_m=0.02)
    decor.vase(console.at(-0.3, -0.16), 0.78, (0.62, 0.24, 0.20), flowers=(0.92, 0.88, 0.90))
    decor.table_lamp(console.at(0.35, -0.16), 0.78)
    decor.picture(console, 2, (0.9, 0.6), z_m=1.68, frame=(0.72, 0.58, 0.30))
    decor.picture(build.at(-0.3, 0.5), 1, (0.55, 0.7), z_m=1.5)
    decor.picture(build.at(-3.3, -1.1, yaw_deg=180), 0, (0.7, 0.55), z_m=1.55)
    decor.picture(build.at(0.2, -1.1, yaw_deg=180), 4, (0.6, 0.75), z_m=1.5)
    decor.picture(build.at(3.6, -1.1, yaw_deg=180), 2, (0.8, 0.6), z_m=1.55)
    decor.palm(build.at(4.88, -0.82), 1.35)
    decor.potted_plant(build.at(4.86, 0.2), 0.8, pot=(0.75, 0.72, 0.66), leaves=110)


def _bedroom(build: Surfaces) -> None:
    seating.bed(_on_wall(build, "bedroom", "west", 1.75), (0.38, 0.50, 0.60), (0.82, 0.58, 0.34))
    for along in (0.55, 2.95):
        stand = _on_wall(build, "bedroom", "west", along)
        storage.sideboard(stand, 0.48, 0.50, (0.50, 0.36, 0.24), depth_m=0.38, doors=1)
        decor.table_lamp(stand.at(0, -0.2), 0.50)
    decor.picture(_on_wall(build, "bedroom", "west", 1.75), 2, (1.1, 0.6), z_m=1.65)
    storage.wardrobe(_on_wall(build, "bedroom", "east", 2.35), 2.0, (0.82, 0.78, 0.70))
    seating.pouf(build.at(-2.1, -2.55), (0.74, 0.42, 0.36))
    decor.palm(build.at(-0.65, -1.6), 1.5, pot=(0.40, 0.42, 0.46))
    decor.radiator(build.at(-2.1, SOUTH_M, yaw_deg=180), 1.2)
    for begin, end in ((1.02, 1.3), (2.92, 3.2)):
        decor.curtain(build.at(0, SOUTH_M, yaw_deg=180), begin, end, (0.52, 0.60, 0.70))
    decor.curtain_rod(build.at(0, SOUTH_M, yaw_deg=180), 0.97, 3.25)
    decor.rug(build.at(-2.3, -3.6), 1.0, 1.5, ((0.87, 0.84, 0.77), (0.55, 0.62, 0.66), (0.45, 0.50, 0.56)))
    decor.picture(build.at(-3.2, -1.2), 4, (0.7, 0.7), z_m=1.5)
    storage.sideboard(build.at(-3.95, -1.2), 1.1, 0.80, (0.82, 0.78, 0.70))


def _study(build: Surfaces) -> None:
    storage.bookshelf(_on_wall(build, "study", "west", 1.35), 2.1, 2.15, (0.45, 0.31, 0.20))
    desk = build.at(2.9, SOUTH_M + 0.44, yaw_deg=180)
    seating.table(desk, (1.7, 0.75, 0.74), (0.55, 0.39, 0.25), seed=9)
    decor.monitor_desk_set(desk.at(0.1, 0.2), 0.74)
    decor.table_lamp(desk.at(-0.65, 0.15), 0.74)
    seating.office_chair(build.at(2.8, -3.78, yaw_deg=15), (0.20, 0.24, 0.28))
    decor.rug(build.at(2.45, -2.55), 2.0, 1.5, ((0.24, 0.36, 0.33), (0.86, 0.77, 0.57), (0.70, 0.44, 0.24)))
    seating.round_table(build.at(2.3, -2.6), 0.38, 0.55, OAK)
    decor.vase(build.at(2.3, -2.6), 0.55, (0.35, 0.50, 0.55), flowers=(0.70, 0.50, 0.80))
    seating.sofa(
        build.at(4.86, -1.66, yaw_deg=-40), (0.50, 0.24, 0.20), width_m=0.94, seats=1, accent=(0.85, 0.75, 0.55)
    )
    decor.floor_lamp(build.at(4.9, -2.55), height_m=1.55)
    storage.bookshelf(_on_wall(build, "study", "east", 2.95), 1.0, 1.25, (0.45, 0.31, 0.20), shelves=3)
    decor.potted_plant(build.at(4.75, -4.4), 1.25, pot=(0.85, 0.82, 0.75))
    decor.picture(_on_wall(build, "study", "north", 3.9), 0, (0.8, 0.55), z_m=1.5)
    decor.picture(_on_wall(build, "study", "north", 0.8), 3, (0.6, 0.75), z_m=1.5)
    decor.picture(build.at(0.9, SOUTH_M, yaw_deg=180), 1, (0.85, 0.85), z_m=1.45)
    for begin, end in ((-4.02, -3.72), (-1.88, -1.58)):
        decor.curtain(build.at(0, SOUTH_M, yaw_deg=180), begin, end, (0.70, 0.46, 0.28))
    decor.curtain_rod(build.at(0, SOUTH_M, yaw_deg=180), -4.1, -1.5)
