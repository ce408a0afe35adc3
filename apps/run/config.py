"""What a run is: its resolved configuration, its identity and its folder."""

import dataclasses
import fcntl
import hashlib
import importlib.metadata
import json
import platform
import subprocess
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from readygo.common.config import section_from_mapping, section_to_mapping
from readygo.common.episode import EpisodeConfig
from readygo.common.errors import ConfigError, RunError
from readygo.common.files import write_whole
from readygo.common.messages import RunSpec, decode, encode
from readygo.common.rasterizer.interface import GPU_BACKENDS
from readygo.common.robot import RobotConfig
from readygo.services.animator.config import AnimatorConfig
from readygo.services.planner.config import HumanPlannerConfig
from readygo.services.planner.expert.config import ExpertConfig
from readygo.services.planner.humans.recipes import PEOPLE_RECIPES, PeopleName
from readygo.services.planner.humans.scenario_file import text_hash
from readygo.services.recorder.config import RecorderConfig
from readygo.services.renderer.config import RendererConfig
from readygo.services.renderer.sensor.config import SENSOR_RECIPES, SensorName

STATE_FOLDER = ".readygo"
_NUMERIC_PACKAGES = ("numpy", "numba", "llvmlite", "scipy", "opencv-python-headless")


@dataclass(frozen=True, kw_only=True)
class RunConfig:
    """Every setting of a run, by section; recorded with its data."""

    robot: RobotConfig = field(default_factory=RobotConfig)
    episode: EpisodeConfig = field(default_factory=EpisodeConfig)
    human_planner: HumanPlannerConfig = field(default_factory=HumanPlannerConfig)
    expert: ExpertConfig = field(default_factory=ExpertConfig)
    animator: AnimatorConfig = field(default_factory=AnimatorConfig)
    renderer: RendererConfig = field(default_factory=RendererConfig)
    recorder: RecorderConfig = field(default_factory=RecorderConfig)


def load_run_config(
    path: Path | None,
    robot: RobotConfig | None = None,
    sensor: SensorName | None = None,
    people: PeopleName | None = None,
) -> RunConfig:
    """The defaults, changed by the sections of a TOML file, by another robot and by recipes of a sensor and of people.

    Raises:
        ConfigError: If the file cannot be read or holds an unknown key or a wrong value.
    """
    if path is None:
        config = RunConfig()
    else:
        try:
            config = section_from_mapping(RunConfig, tomllib.loads(path.read_text()))
        except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
            raise ConfigError(f"Configuration {path} cannot be read: {error}.") from error
    if sensor is not None:
        renderer = dataclasses.replace(config.renderer, sensor=SENSOR_RECIPES[sensor]())
        config = dataclasses.replace(config, renderer=renderer)
    if people is not None:
        episode, planner = PEOPLE_RECIPES[people](config.episode, config.human_planner)
        config = dataclasses.replace(config, episode=episode, human_planner=planner)
    return config if robot is None else dataclasses.replace(config, robot=robot)


def numeric_class(config: RunConfig) -> str:
    """What the bits of a run's samples depend on besides their key: backend, package versions, architecture.

    Raises:
        ReadygoError: If the backend cannot run on this machine.
    """
    from readygo.common.rasterizer.gpu.availability import device_class
    from readygo.common.simd.types import fuses_multiply_adds

    architecture = f"{platform.machine()}{'' if fuses_multiply_adds() else '-without-fma'}"
    versions = [f"{name}-{importlib.metadata.version(name)}" for name in _NUMERIC_PACKAGES]
    backend = config.renderer.backend
    devices = [device_class(backend)] if backend in GPU_BACKENDS else []
    if config.animator.source == "priormdm":
        # Loads torch.
        from readygo.services.animator.priormdm import source

        devices.append(source.numeric_class(config.animator.priormdm))
    return " ".join([backend, *devices, architecture, *versions])


def identity(spec: RunSpec) -> dict[str, Any]:
    """What must be equal for two runs to give the same samples, as plain values."""
    config = {name: section for name, section in spec.config.items() if name != "recorder"}
    return {
        "scene": spec.scene_hash,
        "avatars": spec.avatar_hashes,
        "seed": spec.seed,
        "split": spec.split.value,
        "static": spec.static,
        "scenarios": text_hash(spec.scenarios) if spec.scenarios else "",
        "config": config,
    }


def run_name(spec: RunSpec) -> str:
    """A short name for the run on the bus, from its identity."""
    text = json.dumps(identity(spec), sort_keys=True)
    return f"run-{hashlib.sha256(text.encode()).hexdigest()[:12]}"


def run_metadata(
    config: RunConfig, *, scene: dict[str, Any], avatars: dict[str, dict[str, str]], scenarios: dict[str, str]
) -> dict[str, Any]:
    """What is recorded with the data besides the identity; no scenario file leaves its key out."""
    return {
        **({"scenarios": scenarios} if scenarios else {}),
        "readygo_version": importlib.metadata.version("readygo"),
        "commit": _commit(),
        "numeric_class": numeric_class(config),
        "scene": scene,
        "avatars": avatars,
    }


def resolved_sections(config: RunConfig) -> dict[str, Any]:
    """The configuration as plain mappings, as it travels in the run's spec."""
    return section_to_mapping(config)


@dataclass(frozen=True)
class RunFolder:
    """A data folder: finished shards on top, the run's state below `.readygo`."""

    path: Path

    @property
    def state(self) -> Path:
        """Folder of ledger, blobs, logs and spec."""
        return self.path / STATE_FOLDER

    @property
    def ledger(self) -> Path:
        """The ledger's file."""
        return self.state / "ledger.sqlite"

    @property
    def blobs(self) -> Path:
        """Results between the stages."""
        return self.state / "blobs"

    @property
    def logs(self) -> Path:
        """Logs of the fleet's processes."""
        return self.state / "logs"

    def check(self, spec: RunSpec) -> None:
        """See whether this run may use the folder; changes nothing.

        Raises:
            RunError: If the folder holds another run's data, or files of something else.
        """
        spec_file = self.state / "spec.msgpack"
        if spec_file.exists():
            self._compare(decode(RunSpec, spec_file.read_bytes()), spec)
        elif self.path.exists() and any(entry.name != STATE_FOLDER for entry in self.path.iterdir()):
            raise RunError(f"{self.path} holds files of something else; choose an empty or new folder with --out.")

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Hold the folder's lock, made if it is missing; the lock goes with the process, however that ends.

        Raises:
            RunError: If another process holds it, or the folder cannot be written.
        """
        try:
            self.logs.mkdir(parents=True, exist_ok=True)
            lock = (self.state / "lock").open("w")
        except OSError as error:
            raise RunError(f"{self.path} cannot be written: {error.strerror}.") from error
        with lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                raise RunError(f"Another process is generating into {self.path}; wait for it or stop it.") from error
            yield

    def save(self, spec: RunSpec, wanted: int) -> None:
        """Write what `load` reads.

        Raises:
            RunError: If the folder cannot be written.
        """
        write_whole(self.state / "spec.msgpack", encode(spec), raises=RunError)
        write_whole(self.state / "wanted", str(wanted), raises=RunError)

    def load(self) -> tuple[RunSpec, int]:
        """The run's spec and the number of wanted episodes."""
        try:
            spec = decode(RunSpec, (self.state / "spec.msgpack").read_bytes())
            return spec, int((self.state / "wanted").read_text())
        except (OSError, ValueError) as error:
            raise RunError(f"{self.path} is no data folder of a run: {error}.") from error

    def _compare(self, old: RunSpec, new: RunSpec) -> None:
        theirs, ours = identity(_with_new_settings(old)), identity(_with_new_settings(new))
        different = [key for key in ours if theirs.get(key) != ours[key]]
        if "config" in different:
            sections = [name for name in ours["config"] if theirs["config"].get(name) != ours["config"][name]]
            different[different.index("config")] = f"config ({', '.join(sections) or 'sections'})"
        if different:
            raise RunError(
                f"{self.path} holds data of another run: {', '.join(different)} differ. "
                "Choose another --out, or the settings of that run to resume it."
            )


def _with_new_settings(spec: RunSpec) -> RunSpec:
    """The spec with the settings that it is too old to have: they are added with values that change nothing."""
    # Before samples had labels, none were recorded: what goes on in such a folder must not begin to.
    renderer = {"labels": False, **spec.config.get("renderer", {})}
    try:
        config = section_from_mapping(RunConfig, {**spec.config, "renderer": renderer})
    except ConfigError:
        return spec
    return dataclasses.replace(spec, config=resolved_sections(config))


def _commit() -> str:
    root = Path(__file__).resolve().parents[2]
    if not (root / ".git").exists():
        return ""
    done = subprocess.run(["git", "rev-parse", "HEAD"], cwd=root, capture_output=True, text=True, check=False)
    return done.stdout.strip()
