import dataclasses
import importlib.metadata

import pytest

from readygo.apps.run.config import RunConfig, resolved_sections
from readygo.apps.run.identity import check_same_make, identity, numeric_class, run_name
from readygo.common.errors import RunError
from readygo.common.messages import OnRejection, RunSpec
from readygo.common.messages.stages import EXPERT_LINE
from readygo.services.coordinator import CoordinatorConfig
from readygo.services.recorder import RecorderConfig
from tests.common.messages.run_specs import SPEC


def _with(config: RunConfig) -> RunSpec:
    return dataclasses.replace(SPEC, config=resolved_sections(config))


def test_name_of_a_run_that_began_before_stages_were_data_stays() -> None:
    assert run_name(SPEC) == "run-d7af0b4ebabf"
    assert "stages" not in identity(SPEC)


def test_recorders_and_leases_are_no_part_of_a_runs_identity() -> None:
    other = RunConfig(
        recorder=RecorderConfig(fsync=False), coordinator=CoordinatorConfig(lease_s=1.0, recorders=("a", "b"))
    )
    assert identity(_with(other)) == identity(_with(RunConfig()))


def test_seed_settings_and_stages_are_part_of_a_runs_identity() -> None:
    config = RunConfig()
    stages = (*EXPERT_LINE[:2], dataclasses.replace(EXPERT_LINE[2], on_rejection=OnRejection.KEEP), EXPERT_LINE[3])
    others = [
        dataclasses.replace(SPEC, seed=6),
        dataclasses.replace(SPEC, stages=stages),
        _with(dataclasses.replace(config, renderer=dataclasses.replace(config.renderer, labels=False))),
        _with(config),
    ]
    assert len({run_name(spec) for spec in [SPEC, *others]}) == 5


def test_what_is_recorded_beside_the_samples_is_not() -> None:
    assert run_name(dataclasses.replace(SPEC, scene_path="elsewhere", metadata={"commit": "1"})) == run_name(SPEC)


def test_machine_that_would_make_other_samples_is_refused() -> None:
    config = RunConfig()

    def made(**metadata: str) -> RunSpec:
        return dataclasses.replace(_with(config), metadata={**SPEC.metadata, **metadata})

    ours = {"readygo_version": importlib.metadata.version("readygo"), "numeric_class": numeric_class(config)}
    check_same_make(made(**ours), config)
    with pytest.raises(RunError, match=r"The run is of readygo 0\.0\.9, this is .*: use the same version"):
        check_same_make(made(**{**ours, "readygo_version": "0.0.9"}), config)
    with pytest.raises(RunError, match="samples are of the numeric class 'abacus', this machine's would be of"):
        check_same_make(made(**{**ours, "numeric_class": "abacus"}), config)
