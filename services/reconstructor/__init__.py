"""From a video or photos to posed, undistorted, metric images."""

from typing import TYPE_CHECKING

from readygo.common.lazy import lazy_names

if TYPE_CHECKING:
    from readygo.services.reconstructor.avatars.complete import PersonNetworks as PersonNetworks
    from readygo.services.reconstructor.avatars.config import AvatarFitConfig as AvatarFitConfig
    from readygo.services.reconstructor.avatars.config import AvatarPreset as AvatarPreset
    from readygo.services.reconstructor.avatars.config import avatar_preset as avatar_preset
    from readygo.services.reconstructor.avatars.extract import Extraction as Extraction
    from readygo.services.reconstructor.avatars.extract import ExtractionProgress as ExtractionProgress
    from readygo.services.reconstructor.avatars.extract import HeldOutPerson as HeldOutPerson
    from readygo.services.reconstructor.avatars.extract import extract_avatar as extract_avatar
    from readygo.services.reconstructor.avatars.extract import forget_extraction as forget_extraction
    from readygo.services.reconstructor.avatars.footage import Footage as Footage
    from readygo.services.reconstructor.avatars.footage import write_neuman as write_neuman
    from readygo.services.reconstructor.avatars.footage import write_plain as write_plain
    from readygo.services.reconstructor.avatars.footage import write_views as write_views
    from readygo.services.reconstructor.avatars.keypoints import ANCHORS as ANCHORS
    from readygo.services.reconstructor.avatars.keypoints import HALPE26 as HALPE26
    from readygo.services.reconstructor.avatars.keypoints import KEYPOINTS_FILE as KEYPOINTS_FILE
    from readygo.services.reconstructor.avatars.keypoints import Keypoints as Keypoints
    from readygo.services.reconstructor.avatars.keypoints import write_keypoints as write_keypoints
    from readygo.services.reconstructor.config import ReconstructorConfig as ReconstructorConfig
    from readygo.services.reconstructor.desk import Desk as Desk
    from readygo.services.reconstructor.frames.config import FramesConfig as FramesConfig
    from readygo.services.reconstructor.frames.panorama import panorama_rays as panorama_rays
    from readygo.services.reconstructor.frames.panorama import view_rotations as view_rotations
    from readygo.services.reconstructor.frames.video import write_jpeg as write_jpeg
    from readygo.services.reconstructor.handlers import find_poses as find_poses
    from readygo.services.reconstructor.job import PICTURE_FILE as PICTURE_FILE
    from readygo.services.reconstructor.job import POSE_STAGES as POSE_STAGES
    from readygo.services.reconstructor.job import POSED as POSED
    from readygo.services.reconstructor.marker_sheet import PrintedSheet as PrintedSheet
    from readygo.services.reconstructor.marker_sheet import draw_marker_sheet as draw_marker_sheet
    from readygo.services.reconstructor.marker_sheet import marker_pdf as marker_pdf
    from readygo.services.reconstructor.metric.config import MetricConfig as MetricConfig
    from readygo.services.reconstructor.metric.markers import DEFAULT_DICTIONARY as DEFAULT_DICTIONARY
    from readygo.services.reconstructor.poses.config import PosesConfig as PosesConfig
    from readygo.services.reconstructor.reconstruct import GAUSSIANS as GAUSSIANS
    from readygo.services.reconstructor.reconstruct import STAGES as STAGES
    from readygo.services.reconstructor.reconstruct import Job as Job
    from readygo.services.reconstructor.reconstruct import check_installed as check_installed
    from readygo.services.reconstructor.reconstruct import reconstruct_scene as reconstruct_scene
    from readygo.services.reconstructor.service import ASK_S as ASK_S
    from readygo.services.reconstructor.service import attach as attach
    from readygo.services.reconstructor.service import pull_jobs as pull_jobs
    from readygo.services.reconstructor.similarity import Similarity as Similarity
    from readygo.services.reconstructor.similarity import umeyama as umeyama
    from readygo.services.reconstructor.stages import Say as Say
    from readygo.services.reconstructor.stages import StageProgress as StageProgress
    from readygo.services.reconstructor.training.config import GaussiansConfig as GaussiansConfig
    from readygo.services.reconstructor.training.config import Preset as Preset
    from readygo.services.reconstructor.training.config import preset as preset
    from readygo.services.reconstructor.training.config import weak_texture as weak_texture
    from readygo.services.reconstructor.training.progress import TrainingProgress as TrainingProgress
    from readygo.services.reconstructor.training.train import train_gaussians as train_gaussians
else:
    _NAMES = {
        ".avatars.complete": ("PersonNetworks",),
        ".avatars.config": (
            "AvatarFitConfig",
            "AvatarPreset",
            "avatar_preset",
        ),
        ".avatars.extract": (
            "Extraction",
            "ExtractionProgress",
            "HeldOutPerson",
            "extract_avatar",
            "forget_extraction",
        ),
        ".avatars.footage": (
            "Footage",
            "write_neuman",
            "write_plain",
            "write_views",
        ),
        ".avatars.keypoints": (
            "ANCHORS",
            "HALPE26",
            "KEYPOINTS_FILE",
            "Keypoints",
            "write_keypoints",
        ),
        ".config": ("ReconstructorConfig",),
        ".desk": ("Desk",),
        ".frames.config": ("FramesConfig",),
        ".frames.panorama": (
            "panorama_rays",
            "view_rotations",
        ),
        ".frames.video": ("write_jpeg",),
        ".handlers": ("find_poses",),
        ".job": (
            "PICTURE_FILE",
            "POSED",
            "POSE_STAGES",
        ),
        ".marker_sheet": (
            "PrintedSheet",
            "draw_marker_sheet",
            "marker_pdf",
        ),
        ".metric.config": ("MetricConfig",),
        ".metric.markers": ("DEFAULT_DICTIONARY",),
        ".poses.config": ("PosesConfig",),
        ".reconstruct": (
            "GAUSSIANS",
            "Job",
            "STAGES",
            "check_installed",
            "reconstruct_scene",
        ),
        ".service": (
            "ASK_S",
            "attach",
            "pull_jobs",
        ),
        ".similarity": (
            "Similarity",
            "umeyama",
        ),
        ".stages": (
            "Say",
            "StageProgress",
        ),
        ".training.config": (
            "GaussiansConfig",
            "Preset",
            "preset",
            "weak_texture",
        ),
        ".training.progress": ("TrainingProgress",),
        ".training.train": ("train_gaussians",),
    }
    __all__ = [name for names in _NAMES.values() for name in names]
    __getattr__ = lazy_names(__name__, _NAMES)
