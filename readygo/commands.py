"""The commands of `readygo`, by name. The table is above all layers: it may name functions of any of them."""

import sys
from dataclasses import dataclass
from typing import Literal

from tyro.conf import Positional

from readygo.apps.cli import CliCommand


@dataclass(frozen=True, kw_only=True)
class CompletionOptions:
    """Print a script that completes commands and options in a shell.

    bash: `source <(readygo completion bash)`, in ~/.bashrc; zsh the same in ~/.zshrc; fish:
    `readygo completion fish > ~/.config/fish/completions/readygo.fish`.
    """

    shell: Positional[Literal["bash", "zsh", "fish"]]
    """Shell that the script is for."""


def completion(options: CompletionOptions) -> None:
    """Print a script that completes commands and options in a shell."""
    from readygo.apps.cli_reference import completion as script

    sys.stdout.write(script(COMMANDS, options.shell))


COMMANDS = {
    "demo": CliCommand(
        "readygo.apps.demo.demo:demo", "run the whole pipeline on the embedded scene and write a report"
    ),
    "scene import": CliCommand("readygo.apps.commands.scene:scene_import", "make a scene bundle of a Gaussian file"),
    "scene inspect": CliCommand(
        "readygo.apps.commands.scene:scene_inspect", "measure a scene bundle and draw it from above"
    ),
    "scene report": CliCommand(
        "readygo.apps.commands.scene_report:scene_report", "write the quality report of a scene, as a web page"
    ),
    "scene export": CliCommand(
        "readygo.apps.commands.scene_export:scene_export", "write a scene for other programs: 3DGS, COLMAP, nerfstudio"
    ),
    "scene crop": CliCommand("readygo.apps.commands.scene_edit:scene_crop", "keep a part of a scene"),
    "scene align": CliCommand("readygo.apps.commands.scene_edit:scene_align", "level a scene's floor at height 0"),
    "scene scale": CliCommand("readygo.apps.commands.scene_edit:scene_scale", "make a scene larger or smaller"),
    "scene clean": CliCommand(
        "readygo.apps.commands.scene_edit:scene_clean", "remove huge Gaussians, floaters and haze"
    ),
    "scene capture": CliCommand(
        "readygo.apps.commands.capture:scene_capture", "record a hand-held video of a scene with known poses"
    ),
    "scene poses": CliCommand(
        "readygo.apps.commands.reconstruct:scene_poses",
        "find metric camera poses of a video or photos, without training",
    ),
    "reconstruct": CliCommand(
        "readygo.apps.commands.reconstruct:reconstruct_command", "make a scene bundle of a video or photos"
    ),
    "scene train": CliCommand(
        "readygo.apps.commands.train_gaussians:scene_train", "train Gaussians on posed images (a COLMAP model)"
    ),
    "marker": CliCommand("readygo.apps.commands.reconstruct:marker", "write a printable marker of true size, as PDF"),
    "avatar list": CliCommand("readygo.apps.commands.avatar:avatar_list", "list the avatars of pedestrians"),
    "avatar import": CliCommand(
        "readygo.apps.commands.avatar_import:avatar_import", "make an avatar of a HUGS, SMPL, glTF or Gaussian file"
    ),
    "avatar capture": CliCommand(
        "readygo.apps.commands.avatar_capture:avatar_capture",
        "simulate a video of an avatar, with masks and body poses",
    ),
    "avatar extract": CliCommand(
        "readygo.apps.commands.avatar_extract:avatar_extract", "make an avatar of a person in a video"
    ),
    "avatar preview": CliCommand(
        "readygo.apps.commands.avatar:avatar_preview", "draw an avatar from all sides, or walking in a video"
    ),
    "avatar vary": CliCommand("readygo.apps.commands.avatar:avatar_vary", "make more avatars from a few"),
    "plan": CliCommand(
        "readygo.apps.commands.plan:plan", "replay one episode and explain it in numbers, a picture or a video"
    ),
    "router": CliCommand("readygo.apps.commands.router:router", "let several runs share one fleet"),
    "generate": CliCommand("readygo.apps.commands.generate:generate", "record episodes of a robot among pedestrians"),
    "validate": CliCommand("readygo.apps.commands.data:validate", "read a dataset again and report every defect"),
    "recover": CliCommand(
        "readygo.apps.commands.recover:recover", "keep intact episodes of a damaged dataset, and record the rest again"
    ),
    "requeue": CliCommand(
        "readygo.apps.commands.requeue:requeue", "record again the episodes of a recorder whose disk is lost"
    ),
    "inspect": CliCommand("readygo.apps.commands.data:inspect", "summarise a dataset"),
    "coverage": CliCommand(
        "readygo.apps.commands.coverage:coverage", "show what a dataset covers, and what it does not, on one page"
    ),
    "import rosbag2": CliCommand(
        "readygo.apps.commands.import_log:import_log", "make a data folder of a robot's log, a rosbag2 folder"
    ),
    "import mcap": CliCommand(
        "readygo.apps.commands.import_log:import_log", "make a data folder of a robot's log, an MCAP file"
    ),
    "play": CliCommand("readygo.apps.commands.play:play", "write a recorded episode as a video"),
    "card": CliCommand(
        "readygo.apps.commands.card:card", "write a README.md of a data folder: what it holds, in pictures"
    ),
    "export": CliCommand("readygo.apps.commands.export:export", "export a dataset to the format of another framework"),
    "learn": CliCommand(
        "readygo.apps.commands.learn:learn", "record and train at the same time, until a policy drives well in a scene"
    ),
    "train": CliCommand("readygo.apps.commands.train:train", "train a policy on recorded episodes"),
    "rl": CliCommand(
        "readygo.apps.commands.rl:rl", "train a policy by reinforcement in one scene, on states instead of images"
    ),
    "evaluate": CliCommand("readygo.apps.commands.evaluate:evaluate", "measure success rates in closed loop"),
    "benchmark run": CliCommand(
        "readygo.apps.commands.benchmark:benchmark_run", "drive drivers through the cells of a benchmark suite"
    ),
    "benchmark verify": CliCommand(
        "readygo.apps.commands.benchmark:benchmark_verify", "check results of a suite, and drive a share of them again"
    ),
    "benchmark submit": CliCommand(
        "readygo.apps.commands.benchmark:benchmark_submit", "pack results of a suite into a file that others verify"
    ),
    "benchmark table": CliCommand(
        "readygo.apps.commands.benchmark:benchmark_table", "write the table of the drivers of a suite"
    ),
    "benchmark weights": CliCommand(
        "readygo.apps.commands.benchmark:benchmark_weights", "check the weight files of GNM, ViNT and NoMaD"
    ),
    "sweep": CliCommand(
        "readygo.apps.commands.sweep:sweep", "run a command in arms x scenes x seeds: here, on Slurm, Kubernetes or Ray"
    ),
    "monitor": CliCommand(
        "readygo.apps.commands.monitor:monitor", "show a run on a web page: scene, robots, pedestrians, images, metrics"
    ),
    "drive": CliCommand("readygo.apps.commands.drive:drive", "drive a robot to a goal with a policy and its camera"),
    "simulate-robot": CliCommand(
        "readygo.apps.commands.simulate_robot:simulate_robot",
        "simulate a robot in a scene: publish images and odometry, follow cmd_vel",
    ),
    "status": CliCommand("readygo.apps.commands.status:status", "show the progress of a fleet's run, and its workers"),
    "pause": CliCommand("readygo.apps.commands.control:pause", "pause a fleet: workers get no more work"),
    "resume": CliCommand("readygo.apps.commands.control:resume", "resume a paused fleet"),
    "cancel": CliCommand("readygo.apps.commands.control:cancel", "end a fleet's run; what is recorded stays"),
    "coordinator": CliCommand(
        "readygo.apps.commands.coordinator:coordinator", "coordinate a run whose workers are on other machines"
    ),
    "certs init": CliCommand("readygo.apps.commands.certs:certs_init", "create the certificate authority of a fleet"),
    "certs issue": CliCommand("readygo.apps.commands.certs:certs_issue", "issue certificates for the roles of a fleet"),
    "worker": CliCommand("readygo.apps.fleet.worker:worker", "join a fleet as one worker"),
    "bench render": CliCommand(
        "readygo.benchmarks.rasterizer.render:bench_render",
        "measure images per second, beside the bound and a peer",
    ),
    "bench motion": CliCommand(
        "readygo.benchmarks.motion.gates:bench_motion", "measure how human the gait is, against its gates"
    ),
    "bench plan": CliCommand(
        "readygo.benchmarks.planning.plan:bench_plan", "measure success, times and smoothness of the robot experts"
    ),
    "bench chaos": CliCommand(
        "readygo.benchmarks.fleet.chaos:bench_chaos",
        "record a run among random faults, and compare it with one in peace",
    ),
    "doctor": CliCommand("readygo.apps.commands.doctor:doctor", "check this machine's software, hardware and disk"),
    "completion": CliCommand("readygo.commands:completion", "print a script that completes commands in a shell"),
    "warm": CliCommand("readygo.apps.commands.warm:warm", "compile all kernels once"),
}
