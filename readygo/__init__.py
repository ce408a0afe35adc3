"""readygo: from a Gaussian scene of a real place to navigation data with pedestrians, and to robot policies.

The names below are the library; each module is loaded when one of its names is first used. World: metres, z up.
Robot: x forward, y left. Camera: OpenCV's axes. `T_world_camera` maps camera coordinates to the world.

    from readygo import Dataset

    data = Dataset("out/data")
    data.actions, data.goals_xy_m        # (S, 2) each
    data.decode(0)                       # the first image, uint8 (H, W, 3)
"""

from typing import TYPE_CHECKING

from readygo.common.import_hook import import_after
from readygo.common.lazy import lazy_names

if TYPE_CHECKING:
    from readygo.common.avatars import Avatar as Avatar
    from readygo.common.avatars import load_avatar as load_avatar
    from readygo.common.avatars import load_avatars as load_avatars
    from readygo.common.avatars import pose_avatar as pose_avatar
    from readygo.common.avatars import save_avatar as save_avatar
    from readygo.common.dataset import Calibration as Calibration
    from readygo.common.dataset import Dataset as Dataset
    from readygo.common.dataset import Defect as Defect
    from readygo.common.dataset import EpisodeEntry as EpisodeEntry
    from readygo.common.dataset import Report as Report
    from readygo.common.dataset import validate as validate
    from readygo.common.errors import AvatarError as AvatarError
    from readygo.common.errors import BusError as BusError
    from readygo.common.errors import ConfigError as ConfigError
    from readygo.common.errors import DatasetError as DatasetError
    from readygo.common.errors import MotionError as MotionError
    from readygo.common.errors import PolicyError as PolicyError
    from readygo.common.errors import ReadygoError as ReadygoError
    from readygo.common.errors import RunError as RunError
    from readygo.common.errors import SceneError as SceneError
    from readygo.common.gaussians import GaussianCloud as GaussianCloud
    from readygo.common.gaussians import load_gaussians as load_gaussians
    from readygo.common.gaussians import save_ply as save_ply
    from readygo.common.images.images import Images as Images
    from readygo.common.maps import FloorMap as FloorMap
    from readygo.common.maps import GridFrame as GridFrame
    from readygo.common.maps import OccupancyMap as OccupancyMap
    from readygo.common.maps import load_ros_map as load_ros_map
    from readygo.common.messages.episode import EpisodeKey as EpisodeKey
    from readygo.common.messages.episode import Split as Split
    from readygo.common.policy import Policy as Policy
    from readygo.common.policy import PolicyMemory as PolicyMemory
    from readygo.common.policy import PolicySpec as PolicySpec
    from readygo.common.policy import load_policy as load_policy
    from readygo.common.policy.observation import Observation as Observation
    from readygo.common.rasterizer.backends import StaticCloud as StaticCloud
    from readygo.common.rasterizer.backends import make_rasterizer as make_rasterizer
    from readygo.common.rasterizer.interface import PosedHuman as PosedHuman
    from readygo.common.rasterizer.interface import Rasterizer as Rasterizer
    from readygo.common.rasterizer.interface import View as View
    from readygo.common.robot import CameraConfig as CameraConfig
    from readygo.common.robot import RobotConfig as RobotConfig
    from readygo.common.robot import load_robot as load_robot
    from readygo.common.scenes import Scene as Scene
    from readygo.common.scenes import SceneMaps as SceneMaps
    from readygo.common.scenes import import_scene as import_scene
    from readygo.common.scenes import load_scene as load_scene
    from readygo.common.scenes.embedded import ensure_embedded_scene as ensure_embedded_scene

__version__ = "0.1.0"

_NAMES = {
    "readygo.common.dataset": ("Calibration", "Dataset", "Defect", "EpisodeEntry", "Report", "validate"),
    "readygo.common.messages.episode": ("EpisodeKey", "Split"),
    "readygo.common.policy": ("Policy", "PolicyMemory", "PolicySpec", "load_policy"),
    "readygo.common.policy.observation": ("Observation",),
    "readygo.common.robot": ("CameraConfig", "RobotConfig", "load_robot"),
    "readygo.common.scenes": ("Scene", "SceneMaps", "import_scene", "load_scene"),
    "readygo.common.scenes.embedded": ("ensure_embedded_scene",),
    "readygo.common.maps": ("FloorMap", "GridFrame", "OccupancyMap", "load_ros_map"),
    "readygo.common.gaussians": ("GaussianCloud", "load_gaussians", "save_ply"),
    "readygo.common.avatars": ("Avatar", "load_avatar", "load_avatars", "pose_avatar", "save_avatar"),
    "readygo.common.rasterizer.backends": ("StaticCloud", "make_rasterizer"),
    "readygo.common.rasterizer.interface": ("PosedHuman", "Rasterizer", "View"),
    "readygo.common.images.images": ("Images",),
    "readygo.common.errors": (
        "AvatarError",
        "BusError",
        "ConfigError",
        "DatasetError",
        "MotionError",
        "PolicyError",
        "ReadygoError",
        "RunError",
        "SceneError",
    ),
}
"""The public names, by the module that each is loaded from."""
# Hidden from type checkers: they know all names from the imports above, and so detect missing ones.
if not TYPE_CHECKING:
    __all__ = ["__version__", *(name for names in _NAMES.values() for name in names)]

    __getattr__ = lazy_names(__name__, _NAMES)

    # For "readygo:ReadyGo/PointNav-v0", Gymnasium imports this module and then looks for an environment of that name.
    import_after("gymnasium", "readygo.apps.gym.registration")

    def __dir__() -> list[str]:
        return sorted({*globals(), *__all__})
