"""The manifests are whole, by the schemas of Kubernetes, and their commands are ours.

`kubectl` renders both the Kustomize overlay and, as it holds Go's template engine, the Helm chart; no cluster is asked.
"""

import json
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
import yaml

from readygo.apps.cli import function_of, options_of, read_options
from readygo.apps.options import describe_options
from readygo.commands import COMMANDS

kubernetes_validate = pytest.importorskip("kubernetes_validate", reason="kubernetes-validate is not installed")
DEPLOY = Path(__file__).resolve().parents[2] / "deploy"
CHART = DEPLOY / "helm" / "readygo"
VERSION = "1.31"
FOREIGN = {"Certificate", "Issuer", "ScaledObject", "PodMonitor"}
"""Kinds of cert-manager, KEDA and the Prometheus operator, whose schemas are not at hand."""
Document = dict[str, Any]
RELEASE = {"Name": "lab", "Namespace": "readygo"}
needs_kubectl = pytest.mark.skipif(shutil.which("kubectl") is None, reason="kubectl is not installed")


def _documents(text: str) -> list[Document]:
    return [document for document in yaml.safe_load_all(text) if document]


def _kustomized() -> list[Document]:
    command = ["kubectl", "kustomize", str(DEPLOY / "kubernetes" / "overlays" / "lab")]
    return _documents(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


def _helm(tmp_path: Path, **recorder: Any) -> list[Document]:
    values = yaml.safe_load((CHART / "values.yaml").read_text())
    values["recorder"] |= recorder
    values["scaling"]["enabled"] = True
    values["run"]["arguments"] = ["--seed=1"]
    given = {"apiVersion": "v1", "kind": "ConfigMap", "metadata": {"name": "values"}}
    (tmp_path / "values.json").write_text(json.dumps({**given, "Values": values, "Release": RELEASE}))
    helpers = (CHART / "templates" / "_helpers.tpl").read_text()
    documents = []
    for template in sorted((CHART / "templates").glob("*.yaml")):
        (tmp_path / "template").write_text(helpers + template.read_text())
        command = ["kubectl", "annotate", "--local", "-f", str(tmp_path / "values.json"), "a=b"]
        command += ["-o", f"go-template-file={tmp_path / 'template'}"]
        documents += _documents(subprocess.run(command, capture_output=True, text=True, check=True).stdout)
    return documents


def _plain() -> list[Document]:
    files = sorted((DEPLOY / "kubernetes").rglob("*.yaml"))
    return [doc for file in files if file.name != "kustomization.yaml" for doc in _documents(file.read_text())]


def _check(documents: list[Document]) -> None:
    for document in documents:
        if document["kind"] not in FOREIGN:
            kubernetes_validate.validate(document, VERSION, strict=True)
    for spec in _pods(documents):
        _check_pod(spec)
    _check_certificates(documents)


def _pods(documents: list[Document]) -> list[Document]:
    return [doc["spec"]["template"]["spec"] for doc in documents if doc["kind"] in ("Deployment", "StatefulSet")]


def _check_pod(spec: Document) -> None:
    (container,) = spec["containers"]
    assert spec["securityContext"]["runAsNonRoot"]
    assert container["securityContext"]["readOnlyRootFilesystem"]
    assert {"startupProbe", "livenessProbe", "resources"} <= container.keys()
    mounted = {mount["mountPath"] for mount in container["volumeMounts"]}
    assert {"/cache", "/tmp", "/certs"} <= mounted
    _check_command(container["args"])


def _check_command(words: list[str]) -> None:
    """All options are those of the command; keys of its settings have a dot."""
    known = {option.flag for option in describe_options(options_of(function_of(COMMANDS[words[0]]))).options}
    options = [re.match(r"(--[a-z.-]+)=", word) for word in words if word.startswith("--")]
    options = [option for option in options if option is None or "." not in option[1]]
    assert all(option and option[1] in known for option in options), words


def _check_certificates(documents: list[Document]) -> None:
    """Every secret that is mounted is that of a certificate, under the name that readygo looks for."""
    common_names = {
        doc["spec"]["secretName"]: doc["spec"]["commonName"] for doc in documents if doc["kind"] == "Certificate"
    }
    for spec in _pods(documents):
        (sources,) = [volume["projected"]["sources"] for volume in spec["volumes"] if "projected" in volume]
        secret = sources[0]["secret"]
        name = common_names[secret["name"]]
        assert [item["path"] for item in secret["items"]] == [f"{name}.pem", f"{name}.key", "ca.pem"]


def _asked(scaled: Document) -> set[str]:
    """Of which episodes a ScaledObject asks: those of its own run."""
    (trigger,) = scaled["spec"]["triggers"]
    return set(re.findall(r"{(.*?)}", trigger["metadata"]["query"]))


def test_base_and_overlay_as_they_are_written() -> None:
    _check(_plain())


@needs_kubectl
def test_overlay() -> None:
    documents = _kustomized()
    _check(documents)
    assert {doc["metadata"].get("namespace") for doc in documents if doc["kind"] != "Namespace"} == {"readygo"}
    (scaled,) = [doc for doc in documents if doc["kind"] == "ScaledObject"]
    assert _asked(scaled) == {'stage="render",namespace="readygo"'}
    images = {spec["containers"][0]["image"] for spec in _pods(documents)}
    assert images == {"images.lab.example/readygo-core:0.1.0", "images.lab.example/readygo-worker:0.1.0"}


@needs_kubectl
def test_chart(tmp_path: Path) -> None:
    documents = _helm(tmp_path)
    _check(documents)
    (scaled,) = [doc for doc in documents if doc["kind"] == "ScaledObject"]
    name = scaled["spec"]["scaleTargetRef"]["name"]
    (renderer,) = [doc for doc in documents if (doc["kind"], doc["metadata"]["name"]) == ("Deployment", name)]
    assert "replicas" not in renderer["spec"]
    assert _asked(scaled) == {'stage="render",namespace="readygo",pod="lab-coordinator-0"'}


@needs_kubectl
@pytest.mark.parametrize("names", [["rec0"], ["rec0", "second"]])
def test_charts_coordinator_knows_its_recorders(tmp_path: Path, names: list[str]) -> None:
    documents = _helm(tmp_path, names=names)
    _check(documents)
    (container,) = next(
        doc["spec"]["template"]["spec"]["containers"]
        for doc in documents
        if (doc["kind"], doc["metadata"]["name"]) == ("StatefulSet", "lab-coordinator")
    )
    command, *words = container["args"]
    options = read_options(options_of(function_of(COMMANDS[command])), words, prog=f"readygo {command}")
    assert options.keys["coordinator"]["recorders"] == names


@pytest.mark.skipif(shutil.which("helm") is None, reason="helm is not installed")
def test_helm_renders_the_chart() -> None:
    command = ["helm", "template", "lab", str(CHART), "--set", "scaling.enabled=true"]
    _check(_documents(subprocess.run(command, capture_output=True, text=True, check=True).stdout))


def test_compose_file() -> None:
    compose = yaml.safe_load((DEPLOY / "compose.yaml").read_text())
    for name, service in compose["services"].items():
        _check_command(service["command"])
        assert (service["read_only"], service["cap_drop"]) == (True, ["ALL"]), name
        assert service["restart"] == "on-failure", f"{name} ends with the run"
        # What is of the host is only read.
        own = [volume for volume in service["volumes"] if not volume.endswith(":ro")]
        assert {volume.split(":")[0] for volume in own} <= compose["volumes"].keys()
    targets = re.findall(r"^FROM .* AS (\w+)$", (DEPLOY / "docker" / "Dockerfile").read_text(), re.MULTILINE)
    assert {service["build"]["target"] for service in compose["services"].values() if "build" in service} <= {*targets}


@pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")
def test_systemd_units() -> None:
    units = [str(unit) for unit in sorted((DEPLOY / "systemd").glob("*.service"))]
    done = subprocess.run(["systemd-analyze", "verify", *units], capture_output=True, text=True, check=False)
    ours = [line for line in done.stderr.splitlines() if "readygo" in line]
    assert (done.returncode, ours) == (0, [])


@pytest.mark.parametrize(("unit", "ending"), [("coordinator", "2 78"), ("recorder@", "78"), ("worker@", "78")])
def test_workers_that_nobody_answers_are_started_again(unit: str, ending: str) -> None:
    text = (DEPLOY / "systemd" / f"readygo-{unit}.service").read_text()
    assert f"\nRestartPreventExitStatus={ending}\n" in text
    assert ("\nStartLimitIntervalSec=0\n" in text) == (ending == "78")
