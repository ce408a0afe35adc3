"""Shows shards in Rerun, the robot among people on the map: `python deploy/viewers/rerun_view.py SHARD.mcap...`.

Needs `pip install rerun-sdk`, which readygo itself does not. Opens the viewer, or writes recording and blueprint to the
file of `--save` for `rerun FILE.rrd`.
"""

import argparse
from pathlib import Path
from typing import Any

import rerun as rr
import rerun.blueprint as rrb

POINT_RADII_M = {"/map/points": 0.05, "/episode/path": 0.04, "/humans/joints": 0.06, "/robot/outline": 0.03}


def blueprint() -> Any:
    """The scene from above and behind, the camera's image and the numbers of the robot."""
    radii = {path: rr.Points3D.from_fields(radii=radius_m) for path, radius_m in POINT_RADII_M.items()}
    scene = rrb.Spatial3DView(
        name="Scene",
        origin="/",
        contents=["+ /**", "- /humans/footprints"],
        overrides=radii,
        spatial_information=rrb.SpatialInformation(target_frame="world"),
        line_grid=False,
    )
    camera = rrb.Spatial2DView(name="Camera", origin="/camera/image")
    action = rrb.TimeSeriesView(name="Action", contents=["/robot/action"])
    return rrb.Blueprint(
        rrb.Horizontal(scene, rrb.Vertical(camera, action), column_shares=[2, 1]),
        rrb.TimePanel(timeline="message_log_time", play_state="paused", state="collapsed"),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
    )


def main() -> None:
    """Show or save."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("shards", nargs="+", type=Path, metavar="SHARD.mcap")
    parser.add_argument("--save", type=Path, metavar="FILE.rrd", help="write a file instead of opening the viewer")
    arguments = parser.parse_args()
    rr.init("readygo")
    if arguments.save is None:
        rr.spawn(default_blueprint=blueprint())
    else:
        rr.save(arguments.save, default_blueprint=blueprint())
    for shard in arguments.shards:
        rr.log_file_from_path(shard)


if __name__ == "__main__":
    main()
