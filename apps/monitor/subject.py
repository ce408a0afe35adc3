"""A run that a page can show: its streams, recorded episodes, scene and learning curve."""

import threading
from collections.abc import Callable
from functools import cached_property, partial
from pathlib import Path

import numpy as np

from readygo.apps.learn.curve import load_curve
from readygo.apps.learn.plan import STATE
from readygo.apps.learn.training import read_losses
from readygo.apps.monitor.link import Link, RunAddress, address_of
from readygo.apps.monitor.recorded import Recorded
from readygo.apps.monitor.splats import DollsHouse, dolls_house
from readygo.apps.monitor.track import EpisodeTrack
from readygo.apps.monitor.watch import RunWatch
from readygo.common.camera import SensorConfig
from readygo.common.dataset.index import load_index
from readygo.common.dataset.places import find_shards
from readygo.common.dataset.provenance import Provenance
from readygo.common.dataset.scene_map import MapMessages, map_messages
from readygo.common.drawing.charts import Curve
from readygo.common.errors import ReadygoError, RunError
from readygo.common.messages import EpisodeKey
from readygo.common.robot import RobotConfig
from readygo.common.scenes import Scene
from readygo.runs.folder import RunFolder
from readygo.runs.scene_argument import open_scene
from readygo.runs.world import World

CURVE_FILE, POLICY_FOLDER, DATA_FOLDER = "curve.json", "policy", "data"


class Subject:
    """Read-only view of one run, live or recorded."""

    def __init__(
        self,
        name: str,
        *,
        find: Callable[[], RunAddress] | None = None,
        data: Path | None = None,
        learned: Path | None = None,
        scene: str = "",
    ) -> None:
        """Prepare a run without connecting or reading.

        Args:
            name: Name of the run on the page.
            find: Returns the address of its fleet; None for a run without a fleet.
            data: Its data folder, if that is on this machine.
            learned: Folder of the learning run that it belongs to.
            scene: Its scene, if the run's own entry is missing or wrong.
        """
        self.name, self._find, self._scene, self._learned = name, find, scene, learned
        self.watch = RunWatch()
        self.recorded = Recorded(data) if data is not None else None
        self.link = Link(self.watch, find) if find else None
        self.house: DollsHouse | None = None
        """Scene of the run; None before it is loaded."""
        self.maps: MapMessages | None = None
        """Map of the scene; None before it is loaded."""
        self.note = ""
        """Reason why there is no scene; empty if there is one."""
        if data is not None and RunFolder(data).begun:
            self.watch.spec = RunFolder(data).load()[0]

    @property
    def notes(self) -> str:
        """Parts of the run that cannot be shown, with the reasons."""
        return " ".join(filter(None, (self.note, self.recorded.absent if self.recorded else "")))

    @cached_property
    def robot(self) -> RobotConfig:
        """The run's robot."""
        return self._provenance.robot or RobotConfig()

    @cached_property
    def sensor(self) -> SensorConfig:
        """Variation of the run's cameras from episode to episode."""
        return self._provenance.sensor

    def start(self) -> None:
        """Join the run, and read its scene in the background."""
        if self.link is not None:
            self.link.start()
        threading.Thread(target=self.read_scene, name="scene", daemon=True).start()

    def close(self) -> None:
        """Leave the run."""
        if self.link is not None:
            self.link.close()

    def read_scene(self) -> None:
        """Load the scene, if it is on this machine or can be fetched."""
        try:
            scene = self._found_scene()
            if scene is None:
                self.note = "The run does not say its scene: name it with --scene."
            else:
                self.maps = map_messages(scene.maps.robot, scene.maps.floor)
                self.house = dolls_house(scene)
        except ReadygoError as error:
            self.note = f"The scene is not shown: {error}"

    @property
    def _provenance(self) -> Provenance:
        if self.watch.spec is not None:
            return Provenance.of_run(self.watch.spec)
        if self.recorded is None:
            return Provenance()
        return load_index(find_shards(self.recorded.folder)[0]).provenance

    def _found_scene(self) -> Scene | None:
        if self._scene:
            return open_scene(self._scene)
        spec = self.watch.spec
        if spec is None:
            return None
        if Path(spec.scene_path).is_dir() or self._find is None:
            return World(spec).scene
        bus = self._find().bus()
        try:
            return World(spec, bus).scene
        finally:
            bus.close()

    def track(self, episode: EpisodeKey) -> EpisodeTrack | None:
        """An episode to scrub through: the recorded one, else the received part."""
        if self.recorded is not None and (track := self.recorded.track(episode)) is not None:
            return track
        with self.watch.lock:
            moving = self.watch.moving.get(episode)
            return moving.track() if moving else None

    def losses(self) -> list[Curve]:
        """Losses of training and of held-out episodes over training samples."""
        if self._learned is not None and (losses := read_losses(self._learned / POLICY_FOLDER)):
            return losses
        with self.watch.lock:
            if not len(self.watch.losses):
                return []
            columns = [self.watch.losses.curve(column) for column in (0, 1)]
        return [Curve(name=name, x=x, y=y) for name, (x, y) in zip(("training", "held out"), columns, strict=True)]

    def success(self) -> list[Curve]:
        """Success rates over minutes: of the latest policy-driven episodes, and of measurements."""
        if self._learned is not None:
            points = load_curve(self._learned / CURVE_FILE)
            driven = [(point.minutes, point.driven) for point in points if point.driven is not None]
            measured = [(point.minutes, point.measurement) for point in points if point.measurement is not None]
            curves = [("driving", driven)]
            curves += [(name, [(x, getattr(m, name)) for x, m in measured]) for name in ("static", "dynamic")]
            return [_curve(name, rows) for name, rows in curves if rows]
        with self.watch.lock:
            x, y = self.watch.driven.curve(0) if len(self.watch.driven) else (np.zeros(0), np.zeros(0))
        return [Curve(name="driving", x=x, y=y)] if len(x) else []


def _curve(name: str, rows: list[tuple[float, float]]) -> Curve:
    x, y = np.array(rows, dtype=np.float64).T
    return Curve(name=name, x=x, y=y)


def subjects_of(data: Path, scene: str = "", certs: Path | None = None) -> list[Subject]:
    """The runs in a folder: one run, or all runs of a learning run.

    Raises:
        RunError: If there is no such folder, or no run in it.
    """
    if not data.is_dir():
        raise RunError(
            f"{data} does not exist; name a data folder, a folder of `readygo learn`, or --connect ENDPOINT."
        )
    if (data / STATE).exists():
        places = sorted(folder for folder in (data / DATA_FOLDER).iterdir() if folder.is_dir())
        return [
            _of_folder(folder, folder.name, partial(Subject, learned=data, scene=scene), certs) for folder in places
        ]
    return [_of_folder(data, data.resolve().name, partial(Subject, scene=scene), certs)]


def _of_folder(folder: Path, name: str, make: Callable[..., Subject], certs: Path | None) -> Subject:
    run = RunFolder(folder)
    if run.begun:
        run.load()
        return make(name, find=partial(address_of, run, certs), data=folder)
    find_shards(folder)
    return make(name, data=folder)


def subject_at(address: RunAddress, scene: str = "") -> Subject:
    """Join a run on the network.

    Raises:
        BusError: If the run cannot be joined; the message says why.
        CertificateError: If there is no usable certificate.
    """
    subject = Subject(address.run, find=lambda: address, scene=scene)
    assert subject.link is not None
    subject.link.join()
    return subject
