from readygo.common.camera import CameraConfig, SensorConfig
from readygo.common.messages import EpisodeKey, Split
from readygo.common.robot import RobotConfig
from readygo.services.renderer import calibrations

EPISODES = [EpisodeKey(seed=0, split=Split.TRAIN, index=index) for index in range(2)]
LEFT = CameraConfig(distortion="brown_conrady", k1=-0.1, k2=0.02, p1=0.01, p2=0.03, k3=0.04)


def test_lenses_have_the_names_and_coefficients_of_foxglove() -> None:
    wide = CameraConfig(height_px=24, width_px=40, distortion="fisheye", k1=0.1, k4=0.01)
    robot = RobotConfig(camera=wide, cameras={"left": LEFT, "rear": CameraConfig()})
    first, left, rear = calibrations(robot, SensorConfig(), EPISODES[0])
    assert (first.name, first.height_px, first.width_px) == ("", 24, 40)
    assert (first.distortion_model, first.distortion) == ("kannala_brandt", (0.1, 0.0, 0.0, 0.01))
    assert (left.name, left.distortion_model, left.distortion) == ("left", "plumb_bob", (-0.1, 0.02, 0.01, 0.03, 0.04))
    assert (rear.distortion_model, rear.distortion) == ("", ())
    assert first.K_px == tuple(wide.K_px.ravel())


def test_each_camera_of_each_episode_draws_a_lens_of_its_own() -> None:
    robot, sensor = RobotConfig(camera=LEFT, cameras={"left": LEFT}), SensorConfig(k1=(-0.2, 0.0))
    drawn = [camera.distortion[0] for episode in EPISODES for camera in calibrations(robot, sensor, episode)]
    assert len(set(drawn)) == 4
    assert all(-0.2 <= k1 <= 0.0 for k1 in drawn)
