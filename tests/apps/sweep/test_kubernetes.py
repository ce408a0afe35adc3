from pathlib import Path
from typing import Any

import pytest
import yaml

from readygo.apps.cli import read_options
from readygo.apps.commands.sweep import SweepOptions
from readygo.apps.sweep.kubernetes import PodOptions, job_manifest
from readygo.apps.sweep.plan import PointNeeds
from tests.apps.sweep.sweeps import EVALUATE, read_sweep

VERSION = "1.31"


def _manifest(folder: Path, workers: int = 0) -> tuple[dict[str, Any], dict[str, Any]]:
    pods = PodOptions(image="lab/readygo:1", claim="shared", mount="/work")
    plan, job = yaml.safe_load_all(
        job_manifest(read_sweep(folder), "out", pods, workers=workers, needs=PointNeeds(cpus=2, gpus=1))
    )
    return plan, job


def test_manifest_is_whole_by_the_schemas_of_kubernetes(tmp_path: Path) -> None:
    kubernetes_validate = pytest.importorskip("kubernetes_validate", reason="kubernetes-validate is not installed")
    for document in _manifest(tmp_path):
        kubernetes_validate.validate(document, VERSION, strict=True)


def test_job_has_a_pod_per_point_which_starts_again_after_a_crash(tmp_path: Path) -> None:
    plan, job = _manifest(tmp_path)
    spec = job["spec"]
    assert (spec["completionMode"], spec["completions"], spec["parallelism"]) == ("Indexed", 8, 8)
    assert spec["backoffLimitPerIndex"] == 3
    assert spec["template"]["spec"]["restartPolicy"] == "Never"
    assert [rule["action"] for rule in spec["podFailurePolicy"]["rules"]] == ["Ignore", "FailIndex"]
    assert _manifest(tmp_path, workers=3)[1]["spec"]["parallelism"] == 3
    assert plan["metadata"]["name"] == job["metadata"]["name"] == f"readygo-sweep-{read_sweep(tmp_path).sha256[:12]}"


def test_pods_run_a_point_of_the_same_plan_in_the_shared_volume(tmp_path: Path) -> None:
    plan, job = _manifest(tmp_path)
    pod = job["spec"]["template"]["spec"]
    (container,) = pod["containers"]
    assert plan["data"]["sweep.toml"] == EVALUATE
    assert container["args"][-2:] == ["--point", "$(JOB_COMPLETION_INDEX)"]
    options = read_options(SweepOptions, [*container["args"][1:-1], "5"], prog="readygo sweep")
    assert (options.sweep, options.out, options.point) == (Path("/plan/sweep.toml"), Path("out"), 5)
    assert (container["image"], container["workingDir"]) == ("lab/readygo:1", "/work")
    mounts = {mount["mountPath"]: mount["name"] for mount in container["volumeMounts"]}
    volumes = {volume["name"]: volume for volume in pod["volumes"]}
    assert set(mounts.values()) == set(volumes)
    assert volumes[mounts["/work"]]["persistentVolumeClaim"]["claimName"] == "shared"
    assert volumes[mounts["/plan"]]["configMap"]["name"] == plan["metadata"]["name"]
    assert container["resources"]["requests"] == {"cpu": "2", "nvidia.com/gpu": "1"}
    assert container["securityContext"]["readOnlyRootFilesystem"]
    assert pod["securityContext"]["runAsNonRoot"]
