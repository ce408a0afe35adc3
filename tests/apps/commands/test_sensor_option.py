from pathlib import Path

import pytest

from readygo.apps.run.config import RunConfig, load_run_config
from readygo.apps.run.identity import numeric_class
from readygo.apps.run.spec import make_spec
from readygo.common.config import section_from_mapping
from readygo.common.errors import ConfigError
from readygo.common.messages import Split
from readygo.services.renderer.sensor.config import SENSOR_RECIPES, SensorConfig


def test_recipe_takes_the_place_of_the_configurations_sensor(tmp_path: Path) -> None:
    file = tmp_path / "run.toml"
    file.write_text("[renderer]\ncontact_shadow = true\n[renderer.sensor]\nexposure_ev = 1.0\n")
    assert load_run_config(file).renderer.sensor == SensorConfig(exposure_ev=1.0)
    config = load_run_config(file, sensor="sensor_phone_like")
    assert config.renderer.sensor == SENSOR_RECIPES["sensor_phone_like"]()
    assert config.renderer.contact_shadow
    assert numeric_class(config) == numeric_class(RunConfig())


def test_lens_that_folds_the_robots_image_is_refused_before_the_run() -> None:
    sensor = {"distortion": "brown_conrady", "k1": -0.4}
    config = section_from_mapping(RunConfig, {"renderer": {"sensor": sensor}})

    class SceneThatIsNotReached:
        pass

    with pytest.raises(ConfigError, match=r"k1 -0\.4.* folds the image"):
        make_spec(SceneThatIsNotReached(), None, config, seed=0, split=Split.TRAIN, static=True)  # type: ignore[arg-type]
