"""Features, matches, maps and files of COLMAP models; with its neighbours all that knows pycolmap."""

import signal
import tempfile
import threading
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from readygo.common.arrays import Float64Array, Int64Array
from readygo.common.camera.captured import CapturedViews
from readygo.common.errors import ConfigError, SceneError, first_line
from readygo.common.extras import install_command
from readygo.services.reconstructor.frames.names import image_order
from readygo.services.reconstructor.posed import PosedImages
from readygo.services.reconstructor.poses.config import PosesConfig
from readygo.services.reconstructor.poses.intrinsics import Intrinsics
from readygo.services.reconstructor.poses.tags import tag_matches
from readygo.services.reconstructor.similarity import umeyama

Poses = Mapping[str, Float64Array]
TagFeatures = Mapping[str, tuple[Int64Array, Float64Array]]

MODEL_FILES = ("cameras", "images", "points3D")
_FILES = (*MODEL_FILES, "rigs", "frames")
"""Some models have more than they need."""
_ADJUSTMENTS = 3
"""Times that points are made of matches, and all is adjusted, where poses are known roughly."""
_MANY_IMAGES = 30
"""So many images of one camera determine a lens of four parameters."""
_FEATURES_MAX = 4096
"""Features of an image."""
_PEAK, _FAINT_PEAK = 0.02 / 3, 0.0015
"""Thresholds of SIFT's differences of Gaussians: COLMAP's own, and that for places with little texture."""


def pycolmap() -> Any:
    """The package, quiet.

    Raises:
        ConfigError: If it is not installed.
    """
    terminate = signal.getsignal(signal.SIGTERM)
    try:
        import pycolmap as package
    except ImportError as error:
        raise ConfigError(f"Poses need pycolmap; run: {install_command('reconstruct')}") from error
    if threading.current_thread() is threading.main_thread():
        # Its import takes SIGTERM for itself, to print a trace.
        signal.signal(signal.SIGTERM, terminate)
    package.logging.minloglevel = package.logging.FATAL.value
    return package


def find_model(folder: Path) -> Path | None:
    """Folder of a COLMAP model: the given one, its `sparse/0` or its `sparse`; None if there is none."""
    for place in (folder, folder / "sparse" / "0", folder / "sparse"):
        if any(all((place / f"{name}.{ending}").is_file() for name in MODEL_FILES) for ending in ("bin", "txt")):
            return place
    return None


def model_files(model: Path) -> list[Path]:
    """The files of a COLMAP model; other files of its folder are none."""
    return sorted(path for path in model.iterdir() if path.stem in _FILES and path.suffix in (".bin", ".txt"))


def image_names(model: Path) -> list[str]:
    """Names of the images with a pose, in their order.

    Raises:
        SceneError: If the model cannot be read.
    """
    return [image.name for image in posed_images(open_model(model))]


def moment_numbers(model: Path) -> Int64Array:
    """Number of the moment that each image with a pose shows, counted in their order, shape (V,).

    Views of one 360-degree image, and other images of a rig's frame, show one moment. All other images have one each.
    """
    numbers: dict[int, int] = {}
    frames = (image.frame_id for image in posed_images(open_model(model)))
    return np.array([numbers.setdefault(frame, len(numbers)) for frame in frames], dtype=np.int64)


def posed_images(rec: Any) -> list[Any]:
    """The images of a model that have a pose, in the order of `image_order`."""
    return sorted((rec.images[number] for number in rec.reg_image_ids()), key=lambda image: image_order(image.name))


def extract_features(
    database: Path,
    images: Path,
    names: Sequence[str],
    config: PosesConfig,
    *,
    focal_px: float,
    size_px: Any,
    lens: Intrinsics | Mapping[str, Intrinsics] | None = None,
    masks: Path | None = None,
    features_min: int = 0,
    rig: Mapping[str, Float64Array] | None = None,
) -> None:
    """Write the images' features to a new database; where they are few, again with fainter ones.

    Args:
        database: SQLite file, made here.
        images: Folder of the images.
        names: Relative to that.
        config: How.
        focal_px: Of all images, if it is known [px]; 0: a guess is refined.
        size_px: Width and height, or several of them, if images differ.
        lens: Of all images, or by image, if it is known.
        masks: Folder with a mask NAME.png of each image; where it is 0, there are no features.
        features_min: Where the median image has fewer, fainter ones are taken too, of all images.
        rig: Rotations R_rig_view by folder, where images of one name in these folders were taken at one place; each
            folder has a camera then, with the one lens.
    """
    colmap = pycolmap()
    colmap.set_random_seed(config.seed)
    reader = colmap.ImageReaderOptions()
    one_camera = not isinstance(size_px[0], list)
    reader.camera_model = "OPENCV" if one_camera and len(names) >= _MANY_IMAGES else "SIMPLE_RADIAL"
    if isinstance(lens, Intrinsics):
        reader.camera_model, reader.camera_params = lens.model, ",".join(map(repr, lens.params))
    elif one_camera and focal_px > 0:
        middle = f"{size_px[0] / 2},{size_px[1] / 2}"
        focal = f"{focal_px},{focal_px}" if reader.camera_model == "OPENCV" else f"{focal_px}"
        reader.camera_params = f"{focal},{middle}," + ",".join("0" * (4 if reader.camera_model == "OPENCV" else 1))
    if masks is not None:
        reader.mask_path = masks
    options = colmap.FeatureExtractionOptions()
    options.num_threads, options.use_gpu = config.threads or -1, False
    options.sift.max_num_features = _FEATURES_MAX
    mode = colmap.CameraMode.SINGLE if one_camera and rig is None else colmap.CameraMode.PER_FOLDER
    if isinstance(lens, Mapping):
        mode = colmap.CameraMode.PER_IMAGE
    for peak in (_PEAK, _FAINT_PEAK):
        options.sift.peak_threshold = peak
        database.unlink(missing_ok=True)
        colmap.extract_features(database, images, list(names), mode, reader, options)
        if _median_features(colmap, database) >= features_min:
            break
    if isinstance(lens, Mapping):
        _set_lenses(colmap, database, lens)
    if rig is not None:
        _set_rig(colmap, database, rig)


def _set_rig(colmap: Any, database: Path, rig: Mapping[str, Float64Array]) -> None:
    """Tie images of one name in several folders to each other."""
    cameras = []
    for number, (folder, R_rig_view) in enumerate(rig.items()):
        camera = colmap.RigConfigCamera(image_prefix=f"{folder}/", ref_sensor=number == 0)
        if number:
            R_view_first = R_rig_view.T @ next(iter(rig.values()))
            camera.cam_from_rig = colmap.Rigid3d(colmap.Rotation3d(R_view_first), np.zeros(3))
        cameras.append(camera)
    with colmap.Database.open(database) as db:
        colmap.apply_rig_config([colmap.RigConfig(cameras=cameras)], db)


def _set_lenses(colmap: Any, database: Path, lenses: Mapping[str, Intrinsics]) -> None:
    """Give each image's camera its lens."""
    with colmap.Database.open(database) as db:
        cameras = {camera.camera_id: camera for camera in db.read_all_cameras()}
        for image in db.read_all_images():
            camera, lens = cameras[image.camera_id], lenses[image.name]
            camera.model, camera.params = getattr(colmap.CameraModelId, lens.model), list(lens.params)
            camera.has_prior_focal_length = True
            db.update_camera(camera)


def _median_features(colmap: Any, database: Path) -> float:
    with colmap.Database.open(database) as db:
        return float(np.median([db.num_keypoints_for_image(image.image_id) for image in db.read_all_images()]))


def lens_to_refine(config: PosesConfig) -> dict[str, bool]:
    """What bundle adjustments change of a lens, by COLMAP's names."""
    free = not config.fixes_lens
    return {
        "refine_focal_length": free,
        "refine_extra_params": free,
        "refine_principal_point": free and config.refine_principal_point,
        # Those of the views of 360-degree images are known.
        "refine_sensor_from_rig": False,
    }


def match_features(database: Path, pairs: Sequence[tuple[str, str]], config: PosesConfig) -> None:
    """Match the features of pairs of images; pairs that are matched already are left alone."""
    colmap = pycolmap()
    colmap.set_random_seed(config.seed)
    options = colmap.FeatureMatchingOptions()
    options.num_threads, options.use_gpu = config.threads or -1, False
    pairing = colmap.ImportedPairingOptions()
    with tempfile.TemporaryDirectory() as folder:
        pairing.match_list_path = Path(folder) / "pairs.txt"
        pairing.match_list_path.write_text("".join(f"{a} {b}\n" for a, b in pairs))
        colmap.match_image_pairs(database, options, pairing, _two_views(colmap, config))


def _two_views(colmap: Any, config: PosesConfig) -> Any:
    options = colmap.TwoViewGeometryOptions()
    options.ransac.random_seed = config.seed
    return options


def add_tag_matches(database: Path, tags: TagFeatures, config: PosesConfig) -> None:
    """Add points of markers to the features, and their matches to the matches, of images that show the same ones."""
    colmap = pycolmap()
    colmap.set_random_seed(config.seed)
    with colmap.Database.open(database) as db:
        images = {image.name: image for image in db.read_all_images() if image.name in tags}
        cameras = {camera.camera_id: camera for camera in db.read_all_cameras()}
        begins, pixels = {}, {}
        for name, image in images.items():
            begins[name], pixels[name] = _append_keypoints(db, image.image_id, tags[name][1])
        names = sorted(images)
        for number, first in enumerate(names):
            for second in names[number + 1 :]:
                rows = tag_matches(tags[first][0], tags[second][0])
                if not len(rows):
                    continue
                a, b = images[first], images[second]
                if a.frame_id == b.frame_id:  # views of one 360-degree image: no baseline
                    continue
                rows = (rows + np.array([begins[first], begins[second]])).astype(np.uint32)
                if db.exists_matches(a.image_id, b.image_id):
                    rows = np.concatenate([db.read_matches(a.image_id, b.image_id).reshape(-1, 2), rows])
                    db.delete_matches(a.image_id, b.image_id)
                if db.exists_two_view_geometry(a.image_id, b.image_id):
                    db.delete_two_view_geometry(a.image_id, b.image_id)
                geometry = colmap.estimate_two_view_geometry(
                    cameras[a.camera_id], pixels[first], cameras[b.camera_id], pixels[second], rows,
                    _two_views(colmap, config),
                )  # fmt: skip
                db.write_matches(a.image_id, b.image_id, rows)
                db.write_two_view_geometry(a.image_id, b.image_id, geometry)


def _append_keypoints(db: Any, image_id: int, pixels: Float64Array) -> tuple[int, Float64Array]:
    """Add points without descriptors; gives the number of the first, and where all points are."""
    old = db.read_keypoints(image_id)
    added = np.zeros((len(pixels), old.shape[1]), dtype=np.float32)
    added[:, :2] = pixels
    # Affine shape or scale, by the number of columns.
    added[:, [2, 5] if old.shape[1] == 6 else [2]] = 1.0
    keypoints = np.concatenate([old, added])
    db.update_keypoints(image_id, keypoints)
    return len(old), keypoints[:, :2].astype(np.float64)


def build_maps(
    database: Path, images: Path, folder: Path, config: PosesConfig, *, count: int, few_matches: bool = False
) -> list[Path]:
    """Find poses and points.

    Args:
        database: With features and matches.
        images: Folder of the images.
        folder: Where the models are written, a folder each.
        config: How.
        count: Images there are.
        few_matches: Whether an image that is held by one marker, or by as little, has a pose too; the global mapper
            does not heed it.

    Returns:
        The models, that with the most images first.
    """
    colmap = pycolmap()
    colmap.set_random_seed(config.seed)
    if config.mapper_of(count) == "global":
        options = colmap.GlobalPipelineOptions()
        options.random_seed, options.num_threads = config.seed, config.threads or -1
        for name, value in lens_to_refine(config).items():
            setattr(options.mapper.bundle_adjustment, name, value)
        # For the stages before the bundle adjustment.
        options.mapper.refine_sensor_from_rig = False
        found = colmap.global_mapping(database, images, folder, options)
    else:
        options = colmap.IncrementalPipelineOptions()
        options.random_seed, options.num_threads = config.seed, config.threads or -1
        options.triangulation.random_seed = options.mapper.random_seed = config.seed
        for name, value in lens_to_refine(config).items():
            setattr(options, f"ba_{name}", value)
        # Small pieces are made too, so that the verdict can count them.
        options.min_model_size = 2
        if few_matches:
            # The points of one marker are 16. So few matches of texture can be chance.
            options.mapper.init_min_num_inliers, options.mapper.abs_pose_min_num_inliers = 60, 14
        found = colmap.incremental_mapping(database, images, folder, options)
    order = sorted(found, key=lambda number: (-found[number].num_reg_images(), number))
    return [folder / str(number) for number in order]


def posed_model(
    database: Path,
    images: Path,
    folder: Path,
    like: Path | None,
    poses: Poses,
    config: PosesConfig,
    *,
    focal: float | None = None,
) -> Path:
    """Make a model of images whose poses are known: points from all matches.

    Args:
        database: With features and matches.
        images: Folder of the images.
        folder: Where the model is written.
        like: A model whose cameras are taken; None takes those of the database.
        poses: T_world_camera by image.
        config: How.
        focal: Factor of the focal length, with poses that stay as they are; None: both are rough and are adjusted.

    Returns:
        `folder`.
    """
    colmap = pycolmap()
    rec = _images_without_pose(database)
    for number, camera in colmap.Reconstruction(like).cameras.items() if like is not None else ():
        _take_lens(rec.camera(number), camera, focal or 1.0)
    for image in list(rec.images.values()):
        if image.name in poses:
            T = np.linalg.inv(poses[image.name])
            pose = colmap.Rigid3d(colmap.Rotation3d(T[:3, :3]), T[:3, 3])
            image.frame.set_cam_from_world(image.camera_id, pose)
            rec.register_frame(image.frame_id)
    options = colmap.IncrementalPipelineOptions()
    options.random_seed, options.num_threads = config.seed, config.threads or -1
    options.triangulation.random_seed = options.mapper.random_seed = config.seed
    options.triangulation.ignore_two_view_tracks = False
    adjusting = colmap.BundleAdjustmentOptions()
    adjusting.print_summary = False
    for name, value in lens_to_refine(config).items():
        setattr(adjusting, name, value)
    adjusting.ceres.loss_function_type = colmap.LossFunctionType.SOFT_L1
    adjusting.ceres.solver_options.num_threads = config.threads or -1
    folder.mkdir()
    for _ in range(_ADJUSTMENTS if focal is None else 1):
        rec = colmap.triangulate_points(rec, database, images, folder, True, options)
        if focal is None and rec.num_points3D():
            colmap.bundle_adjustment(rec, adjusting)
    rec.update_point_3d_errors()
    rec.write(folder)
    return folder


def given_model(
    database: Path, images: Path, folder: Path, poses: Poses, config: PosesConfig, *, adjust: bool
) -> Path | None:
    """Make a model of images that came with poses and lenses: points from all matches, in the frame of the poses.

    Args:
        database: With features and matches, and the lenses.
        images: Folder of the images.
        folder: Where the model is written.
        poses: T_world_camera by image.
        config: How.
        adjust: Poses are adjusted to the matches, and then moved as one to where they were; lenses stay.

    Returns:
        `folder`; None if too few images share anything: two are needed, three to adjust poses.
    """
    # Three places tell how the poses are moved back.
    needed = 3 if adjust else 2
    if sum(image.name in poses for image in _images_without_pose(database).images.values()) < needed:
        return None
    fixed = replace(config, intrinsics="given", intrinsics_are="fixed")
    posed_model(database, images, folder, None, poses, fixed, focal=None if adjust else 1.0)
    if not adjust:
        return folder
    colmap = pycolmap()
    rec = colmap.Reconstruction(folder)
    found = {rec.images[number].name: rec.images[number].projection_center() for number in rec.reg_image_ids()}
    names = sorted(found)
    back = umeyama(np.array([found[name] for name in names]), np.array([poses[name][:3, 3] for name in names]))
    rec.transform(colmap.Sim3d(back.scale, colmap.Rotation3d(back.R), back.t))
    rec.write(folder)
    return folder


def _take_lens(camera: Any, other: Any, factor: float) -> None:
    params = np.array(other.params)
    params[list(other.focal_length_idxs())] *= factor
    camera.params = params


def _images_without_pose(database: Path) -> Any:
    """All images of a database, without poses."""
    colmap = pycolmap()
    rec = colmap.Reconstruction()
    with colmap.Database.open(database) as db:
        rec.load(colmap.DatabaseCache.create(db, colmap.DatabaseCacheOptions()))
    return rec


def piece_sizes(models: Sequence[Path]) -> tuple[int, ...]:
    """Images with a pose in each model that none before it has."""
    colmap, sizes = pycolmap(), []
    known: set[str] = set()
    for model in models:
        rec = colmap.Reconstruction(model)
        names = {rec.images[number].name for number in rec.reg_image_ids()}
        sizes.append(len(names - known))
        known |= names
    return tuple(size for size in sizes if size)


def read_map(model: Path) -> PosedImages:
    """A COLMAP model as arrays.

    Raises:
        SceneError: If it cannot be read.
    """
    rec = open_model(model)
    images = posed_images(rec)
    cameras = [image.camera for image in images]
    ids = sorted(rec.points3D)
    number_of = {image.image_id: number for number, image in enumerate(images)}
    points = [rec.points3D[number] for number in ids]
    seen = {(number_of[e.image_id], n) for n, p in enumerate(points) for e in p.track.elements}

    def rays(view: int, pixels: Float64Array) -> Float64Array:
        # The model stays alive as long as its cameras are asked.
        assert rec is not None
        return np.asarray(cameras[view].cam_from_img(np.asarray(pixels, dtype=np.float64)))

    return PosedImages(
        names=tuple(image.name for image in images),
        T_world_camera=np.array([_pose(image) for image in images]).reshape(-1, 4, 4),
        focal_px=np.array([camera.mean_focal_length() for camera in cameras]),
        size_px=np.array([[camera.width, camera.height] for camera in cameras]),
        rays=rays,
        points=np.array([point.xyz for point in points]).reshape(-1, 3),
        points_rgb=np.array([point.color for point in points], dtype=np.uint8).reshape(-1, 3),
        seen=np.array(sorted(seen), dtype=np.int64).reshape(-1, 2),
        errors_px=np.array([max(point.error, 0.0) for point in points]),
    )


def open_model(model: Path) -> Any:
    """A model as pycolmap has it.

    Raises:
        SceneError: If it cannot be read.
    """
    try:
        return pycolmap().Reconstruction(model)
    except (ValueError, RuntimeError, OSError) as error:
        raise SceneError(f"{model} cannot be read as a COLMAP model: {first_line(error)}.") from error


def is_pinhole(model: Path) -> bool:
    """Whether all cameras of a model are without distortion."""
    cameras = open_model(model).cameras.values()
    return all(camera.model.name in ("PINHOLE", "SIMPLE_PINHOLE") for camera in cameras)


def has_tracks(model: Path) -> bool:
    """Whether a model has no images, or one that sees a point."""
    images = open_model(model).images.values()
    return not images or any(image.num_points3D for image in images)


def pinhole_views(model: Path) -> CapturedViews:
    """The cameras of a model without distortion, in the order of their images' names."""
    rec = open_model(model)
    images = posed_images(rec)
    return CapturedViews(
        images=tuple(image.name for image in images),
        sizes_px=np.array([[image.camera.width, image.camera.height] for image in images]).reshape(-1, 2),
        K_px=np.array([image.camera.calibration_matrix() for image in images]).reshape(-1, 3, 3),
        T_world_camera=np.array([_pose(image) for image in images]).reshape(-1, 4, 4),
    )


def _pose(image: Any) -> Float64Array:
    T = np.eye(4)
    T[:3] = image.cam_from_world().inverse().matrix()
    return T
