"""Points of a sweep as an Indexed Job of Kubernetes: a pod per point, with a shared volume."""

from dataclasses import dataclass
from typing import Any

import yaml

from readygo.apps.cli import USER_MISTAKE
from readygo.apps.sweep.plan import PointNeeds, Sweep

INDEX = "$(JOB_COMPLETION_INDEX)"
"""What the kubelet replaces by the number of a pod's point."""
PLAN_FOLDER, PLAN_FILE = "/plan", "sweep.toml"
USER = 10001
"""User of the images in deploy/docker."""
GPU = "nvidia.com/gpu"
RETRIES = 3
"""How often a point starts again after a crash or a lost node."""


@dataclass(frozen=True, kw_only=True)
class PodOptions:
    """The pods of a sweep on Kubernetes."""

    image: str = "readygo-trainer"
    """Image with the packages that the command needs."""
    claim: str = "readygo-data"
    """Claim of a volume that all pods can write to (ReadWriteMany); its root is the pods' working folder, below which
    scenes, inputs and `out` lie."""
    mount: str = "/data"
    """Where the volume is mounted in the pods."""


def job_manifest(sweep: Sweep, out: str, pods: PodOptions, *, workers: int, needs: PointNeeds) -> str:
    """The manifest of a sweep: a ConfigMap with its file, and a Job with a pod per point, as YAML.

    Args:
        sweep: The sweep.
        out: Its folder, as the pods see it.
        pods: Image and volume.
        workers: Most pods at a time; 0 for as many as there are points.
        needs: Cores and GPUs of a pod.
    """
    name = f"readygo-sweep-{sweep.sha256[:12]}"
    plan = {
        "apiVersion": "v1",
        "kind": "ConfigMap",
        "metadata": {"name": name},
        "immutable": True,
        "data": {PLAN_FILE: sweep.text.decode()},
    }
    count = len(sweep.points)
    job = {
        "apiVersion": "batch/v1",
        "kind": "Job",
        "metadata": {"name": name},
        "spec": {
            "completionMode": "Indexed",
            "completions": count,
            "parallelism": min(workers or count, count),
            "backoffLimitPerIndex": RETRIES,
            # A lost node is no failure of the point; a mistake of the user stays one.
            "podFailurePolicy": {
                "rules": [
                    {"action": "Ignore", "onPodConditions": [{"type": "DisruptionTarget", "status": "True"}]},
                    {
                        "action": "FailIndex",
                        "onExitCodes": {"containerName": "point", "operator": "In", "values": [USER_MISTAKE]},
                    },
                ]
            },
            "template": {"spec": _pod(name, out, pods, needs)},
        },
    }
    return str(yaml.safe_dump_all([plan, job], sort_keys=False))


def _pod(name: str, out: str, pods: PodOptions, needs: PointNeeds) -> dict[str, Any]:
    reserved = {"cpu": str(needs.cpus)} | ({GPU: str(needs.gpus)} if needs.gpus else {})
    return {
        "restartPolicy": "Never",
        "automountServiceAccountToken": False,
        "terminationGracePeriodSeconds": 60,
        "securityContext": {
            "runAsNonRoot": True,
            "runAsUser": USER,
            "runAsGroup": USER,
            "fsGroup": USER,
            "seccompProfile": {"type": "RuntimeDefault"},
        },
        "containers": [
            {
                "name": "point",
                "image": pods.image,
                "workingDir": pods.mount,
                "args": ["sweep", f"{PLAN_FOLDER}/{PLAN_FILE}", "--out", out, "--point", INDEX],
                "resources": {"requests": dict(reserved), "limits": dict(reserved)},
                "securityContext": {
                    "allowPrivilegeEscalation": False,
                    "readOnlyRootFilesystem": True,
                    "capabilities": {"drop": ["ALL"]},
                },
                "volumeMounts": [
                    {"name": "data", "mountPath": pods.mount},
                    {"name": "plan", "mountPath": PLAN_FOLDER, "readOnly": True},
                    {"name": "cache", "mountPath": "/cache"},
                    {"name": "tmp", "mountPath": "/tmp"},
                ],
            }
        ],
        "volumes": [
            {"name": "data", "persistentVolumeClaim": {"claimName": pods.claim}},
            {"name": "plan", "configMap": {"name": name}},
            {"name": "cache", "emptyDir": {}},
            {"name": "tmp", "emptyDir": {}},
        ],
    }
