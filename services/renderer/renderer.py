"""A scene with its avatars and a robot's cameras: from shots to the images that the cameras record."""

import dataclasses
from collections import OrderedDict
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path

from readygo.common.arrays import AnyArray, Float64Array
from readygo.common.avatars import Avatar, LabelModel
from readygo.common.avatars.mesh_look import fixed_light, mesh_like
from readygo.common.camera import CameraConfig
from readygo.common.camera.lens import make_lens
from readygo.common.episode.robot import robot_of_episode
from readygo.common.errors import AvatarError, RunError
from readygo.common.files import cache_root
from readygo.common.gaussians import load_gaussians
from readygo.common.images.images import FIELDS, Images
from readygo.common.images.names import RGB, camera_of, cameras_of, images_of, kind_of, kinds_of
from readygo.common.lighting.probes import load_or_make_probes, make_probes
from readygo.common.messages import EpisodeKey, HumanMotion, Humans
from readygo.common.policy.sight import camera_on
from readygo.common.rasterizer.backends import StaticCloud, make_rasterizer, packed_cloud
from readygo.common.rasterizer.interface import PinholeCamera, Rasterizer, View, render_each
from readygo.common.robot import RobotConfig
from readygo.common.scenes import Scene
from readygo.common.scenes.scene import CLOUD_FILE, SKY_FILE
from readygo.services.renderer.camera import (
    EpisodeCamera,
    Shot,
    SubFrame,
    exposure_gain,
    make_shutter,
    pinhole_of,
    sensor_key,
    sensor_rng,
)
from readygo.services.renderer.config import RendererConfig
from readygo.services.renderer.faces import Faces, Remap, face_poses, make_remap
from readygo.services.renderer.humans import feet_of, shadow_cloud, stands_of
from readygo.services.renderer.light import develop

HUMANS_KEPT = 512
"""Keys of humans that a renderer remembers."""
EPISODE_CAMERAS_KEPT = 16
"""Episodes whose cameras a renderer keeps; the remap of a lens takes 3 MB for an image of 144x256."""


class Renderer:
    """One scene with its avatars, ready to be drawn.

    Args:
        scene: The scene bundle.
        avatars: Avatars by name.
        robot: The robot with the cameras.
        config: Settings.

    Raises:
        ReadygoError: If the backend cannot run here, or a camera's lens or range cannot be drawn.
    """

    def __init__(self, scene: Scene, avatars: Mapping[str, Avatar], robot: RobotConfig, config: RendererConfig) -> None:
        config.check_robot(robot)
        self.scene, self.robot, self.config = scene, robot, config
        # Gaussians stay with the rasterizers, which map them from the scene's cache if they can.
        self.skeletons = {name: avatar.skeleton() for name, avatar in avatars.items()}
        self.label_models = {name: LabelModel.from_avatar(avatar) for name, avatar in avatars.items() if config.labels}
        cameras = {"": robot.camera, **robot.cameras}
        self.pinholes = {name: pinhole_of(config.sensor, camera) for name, camera in cameras.items()}
        """What the rasterizer of each camera draws with, by the camera's name; the first one is called ""."""
        self.rasterizers: dict[str, Rasterizer] = {}
        """The rasterizer of each camera; cameras of equal pinholes share one."""
        for name, pinhole in self.pinholes.items():
            alike = next((other for other in self.rasterizers if _draws_like(self.pinholes[other], pinhole)), None)
            self.rasterizers[name] = (
                _scene_rasterizer(scene, avatars, pinhole, config) if alike is None else self.rasterizers[alike]
            )
        self._light = scene_light(scene, config)
        self._people: OrderedDict[str, tuple[HumanMotion, ...]] = OrderedDict()
        self._cameras: OrderedDict[tuple[str, EpisodeKey | str], EpisodeCamera] = OrderedDict()

    @property
    def recorded_images(self) -> tuple[str, ...]:
        """Names of the images that are recorded, of all cameras."""
        return images_of(tuple(self.rasterizers), self.config.outputs)

    def render(self, shots: Sequence[Shot], names: Sequence[str] = (RGB,)) -> Iterator[dict[str, Images]]:
        """What the robot's cameras show, shot after shot.

        Args:
            shots: The times at which the cameras take an image.
            names: The images that are wanted, see `readygo.common.images.names`.

        Yields:
            The images of each camera, by its name; the first one is called "".

        Raises:
            RunError: If the robot has no such camera.
        """
        cameras, taken = cameras_of(names), []
        if unknown := [camera for camera in cameras if camera not in self.rasterizers]:
            raise RunError(f"The robot has no camera {unknown[0]!r}; it has {', '.join(self.robot.all_cameras)}.")
        for camera in cameras:
            taken.append(self.draw(camera, shots, self.config.rasterizer_outputs(kinds_of(camera, names))))
        for images in zip(*taken, strict=True):
            yield {camera: self._with_depth(one) for camera, one in zip(cameras, images, strict=True)}

    def draw(self, name: str, shots: Sequence[Shot], outputs: tuple[str, ...]) -> Iterator[Images]:
        """What one camera shows, shot after shot; drawn as it is taken, as the images of an episode fill much memory.

        Args:
            name: The camera's name; empty for the first one.
            shots: The times at which it takes an image.
            outputs: Names out of `readygo.common.images.images.OUTPUTS`, whose depth is the mean.
        """
        rasterizer = self.rasterizers[name]
        exposed: list[tuple[EpisodeCamera, Shot, list[SubFrame]]] = []
        views: list[tuple[View, tuple[str, ...]]] = []
        for number, shot in enumerate(shots, start=1):
            camera = self.episode_camera(name, shot.episode)
            sub_frames = camera.sub_frames(shot)
            exposed.append((camera, shot, sub_frames))
            for sub_frame in sub_frames:
                views += self._views(camera, sub_frame, outputs)
            # A GPU draws the views of several shots at once, a CPU view after view.
            if len(views) >= rasterizer.views_at_once or number == len(shots):
                drawn = render_each(rasterizer, views)
                yield from (develop(*exposure, drawn) for exposure in exposed)
                exposed, views = [], []

    def episode_camera(self, name: str, episode: EpisodeKey | str) -> EpisodeCamera:
        """A camera of an episode's robot, with the values that its sensor drew; the latest ones are kept.

        Args:
            name: The camera's name; empty for the first one.
            episode: The episode, or a text that stands for one.
        """
        if (name, episode) not in self._cameras:
            robot = self.robot if isinstance(episode, str) else robot_of_episode(self.robot, episode)
            camera, key = camera_on(robot, name), sensor_key(episode, name)
            config = self.config.sensor.draw_camera(camera, sensor_rng(key))
            same_view = camera.horizontal_fov_deg == camera_on(self.robot, name).horizontal_fov_deg
            self._cameras[name, episode] = EpisodeCamera(
                name=name,
                config=config,
                shutter=make_shutter(config, self.config.sub_frames, self.robot.clock.dt_s),
                gain=exposure_gain(config),
                key=key,
                remap=self._remap(name, config),
                K_px=None if same_view else camera.K_px,
            )
            while len(self._cameras) > EPISODE_CAMERAS_KEPT * len(self.rasterizers):
                self._cameras.popitem(last=False)
        self._cameras.move_to_end((name, episode))
        return self._cameras[name, episode]

    def remember(self, people: Humans) -> None:
        """Keep humans for later requests.

        Raises:
            AvatarError: If one of them wears an avatar that is not loaded.
        """
        self.check_avatars(people.humans)
        self._people[people.key] = people.humans

    def recall(self, key: str) -> tuple[HumanMotion, ...] | None:
        """Humans by key: an empty tuple for the empty key, None for an unknown key."""
        if not key:
            return ()
        if key in self._people:
            self._people.move_to_end(key)
        return self._people.get(key)

    def forget_old(self) -> None:
        """Drop the humans that were not asked for longest."""
        while len(self._people) > HUMANS_KEPT:
            self._people.popitem(last=False)

    def check_avatars(self, humans: tuple[HumanMotion, ...]) -> None:
        """Raise AvatarError unless every human's avatar is loaded."""
        for human in humans:
            if human.avatar not in self.skeletons:
                raise AvatarError(f"Avatar {human.avatar!r} is not loaded; loaded: {sorted(self.skeletons)}.")

    def _with_depth(self, images: Images) -> Images:
        """The images with the depth that the settings ask for as their depth, where there is one."""
        return dataclasses.replace(images, depth_m=images.median_depth_m) if self.config.depth == "median" else images

    def _remap(self, name: str, config: CameraConfig) -> Remap | None:
        """The way through a camera's lens, made once for episodes of the same lens; None without a lens."""
        pinhole = self.pinholes[name]
        if not isinstance(pinhole, Faces):
            return None
        for camera in self._cameras.values():
            if camera.name == name and camera.config.coefficients == config.coefficients:
                return camera.remap
        return make_remap(make_lens(config), pinhole)

    def _views(
        self, camera: EpisodeCamera, sub_frame: SubFrame, outputs: tuple[str, ...]
    ) -> Iterator[tuple[View, tuple[str, ...]]]:
        """What the rasterizer draws of a sub-frame: a view for each face, and the images that are made of it."""
        if not sub_frame.rows.any():
            outputs = (RGB,)
        maps, humans = self.scene.maps, sub_frame.humans
        shadowed, on_floor = self.config.draws("contact_shadow"), self.config.draws("feet_on_floor")
        feet = feet_of(self.skeletons, humans if shadowed or on_floor else ())
        shadows = shadow_cloud(feet, maps.floor, sub_frame.T_world_camera[:3, 3]) if shadowed else None
        if self._light is not None:
            at = [self._light(float(human.root_m[0]), float(human.root_m[1])) for human in humans]
            humans = tuple(dataclasses.replace(human, light=light) for human, light in zip(humans, at, strict=True))
        for T_world_camera in face_poses(sub_frame.T_world_camera, camera.remap):
            if on_floor:
                stands = stands_of(feet, maps.floor, maps.robot, T_world_camera).tolist()
                humans = tuple(
                    dataclasses.replace(human, ground_m=ground_m, lead_m=lead_m)
                    for human, (ground_m, lead_m) in zip(humans, stands, strict=True)
                )
            yield View(T_world_camera=T_world_camera, humans=humans, shadows=shadows, K_px=camera.K_px), outputs


def view_image(views: Mapping[str, Images], name: str) -> AnyArray:
    """One of the images that cameras show, by its name."""
    image: AnyArray = getattr(views[camera_of(name)], FIELDS[kind_of(name)])
    return image


def scene_light(scene: Scene, config: RendererConfig) -> Callable[[float, float], Float64Array] | None:
    """The light at a place x, y [m] as in `irradiance_matrix`, from the scene's cache or made there.

    None draws humans in their avatars' own colours.
    """
    if config.human_look == "mesh":
        fixed = fixed_light()
        return lambda *_: fixed
    if not config.human_light:
        return None
    folder, maps = pack_folder(scene), scene.maps
    return load_or_make_probes(
        folder / f"light-{scene.content_hash[:16]}.npz",
        lambda: make_probes([packed_cloud(one, folder) for one in static_clouds(scene)], maps.human, maps.floor),
    ).at


def static_clouds(scene: Scene) -> list[StaticCloud]:
    """The scene and, if it has one, its sky."""
    files = [CLOUD_FILE, *([SKY_FILE] if SKY_FILE in scene.metadata["files"] else [])]
    return [
        StaticCloud(key=f"{scene.content_hash[:16]}-{Path(name).stem}", load=partial(load_gaussians, scene.path / name))
        for name in files
    ]


def pack_folder(scene: Scene) -> Path:
    """Folder of the bundle's packs, which can be made again."""
    return scene.path / "cache"


def avatar_pack_folder() -> Path:
    """Folder of packed avatars, which all scenes share and which can be made again."""
    return cache_root() / "avatars"


def _scene_rasterizer(
    scene: Scene, avatars: Mapping[str, Avatar], pinhole: PinholeCamera, config: RendererConfig
) -> Rasterizer:
    mesh = config.human_look == "mesh"
    return make_rasterizer(
        config.backend,
        static_clouds(scene),
        {name: mesh_like(avatar) for name, avatar in avatars.items()} if mesh else avatars,
        pinhole,
        cache=pack_folder(scene),
        avatar_cache=avatar_pack_folder(),
        outputs=config.rasterizer_outputs(config.outputs),
        detail=config.detail,
    )


def _draws_like(one: PinholeCamera, two: PinholeCamera) -> bool:
    """True if the same images are drawn for both."""
    return one.height_px == two.height_px and one.width_px == two.width_px and bool((one.K_px == two.K_px).all())
