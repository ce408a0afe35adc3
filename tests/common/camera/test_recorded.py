from readygo.common.camera import CameraConfig, SensorConfig
from readygo.common.camera.recorded import with_whole_camera
from readygo.common.config import section_from_mapping

NAMES = ("k1", "k2", "k3", "k4", "p1", "p2", "exposure_ev", "vignetting", "shot_noise", "read_noise", "exposure_s")
OLD_CAMERA = {"height_px": 144, "width_px": 256, "horizontal_fov_deg": 100.0, "mount_height_m": 0.5}


def old_config(**sensor):
    constants = {name: 0.0 for name in NAMES} | {"red_gain": 1.0, "blue_gain": 1.0, "readout_s": 0.0}
    ranges = {name: [] for name in constants}
    whole = {"distortion": "none", **constants, "sub_frames": 8, "ranges": ranges} | sensor
    return {
        "robot": {"v_max_mps": 0.7, "camera": OLD_CAMERA},
        "renderer": {"backend": "cpu", "sensor": whole},
        "seed": 3,
    }


def test_old_sensor_becomes_the_camera_and_what_varies_of_it() -> None:
    ranges = {"k1": [-0.04, 0.01], "exposure_s": [0.005, 0.01], "k2": []}
    config = with_whole_camera(old_config(distortion="brown_conrady", k2=0.002, sub_frames=4, ranges=ranges))
    camera = section_from_mapping(CameraConfig, config["robot"]["camera"])
    # What a range replaces is in the middle of it, as in a recipe of today.
    assert camera == CameraConfig(distortion="brown_conrady", k1=-0.015, k2=0.002, exposure_s=0.0075)
    assert config["robot"]["v_max_mps"] == 0.7
    sensor = section_from_mapping(SensorConfig, config["renderer"]["sensor"])
    assert sensor == SensorConfig(k1=(-0.04, 0.01), exposure_s=(0.005, 0.01))
    assert (config["renderer"]["sub_frames"], config["renderer"]["backend"], config["seed"]) == (4, "cpu", 3)


def test_pinhole_of_then_is_the_pinhole_of_today() -> None:
    config = with_whole_camera(old_config())
    assert section_from_mapping(CameraConfig, config["robot"]["camera"]) == CameraConfig()


def test_sections_of_today_and_of_before_there_was_a_sensor_are_left_alone() -> None:
    for config in ({}, {"robot": {}}, {"renderer": {"sensor": {"k1": [0.0, 0.1]}}}, {"renderer": {"backend": "cpu"}}):
        assert with_whole_camera(config) == config
