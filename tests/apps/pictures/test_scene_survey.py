import numpy as np

from readygo.apps.pictures.scene_survey import COLOURS, _round_step, change_picture, survey_picture
from readygo.common.scenes.survey import survey
from tests.common.scenes.small_room import small_room


def test_survey_draws_three_views_and_the_floor_that_it_found():
    cloud = small_room()
    found = survey(cloud)
    picture = survey_picture(cloud, found, "room.ply")
    assert picture.shape[1] > 1000
    assert (picture == np.array(COLOURS[0])).all(axis=2).sum() > 500


def test_change_shows_before_above_after():
    cloud = small_room()
    part = cloud.select(cloud.means_m[:, 0] < 2.0)
    picture = change_picture(cloud, part, "cropped")
    assert picture.shape[0] > 500


def test_survey_and_change_look_as_they_did(golden_image, monkeypatch):
    monkeypatch.setattr("readygo.apps.pictures.scene_survey.VIEW_PX", 170)
    cloud = small_room()
    golden_image("scene_survey", survey_picture(cloud, survey(cloud), "room.ply"))
    part = cloud.select(cloud.means_m[:, 0] < 2.6)
    golden_image("scene_change", change_picture(cloud, part, "cropped"))


def test_steps_of_the_grid_are_the_next_round_number():
    values = [0.011, 0.02, 0.021, 0.05, 0.3, 0.51, 1.0, 1.01, 7.0, 34.0]
    wanted = [0.02, 0.02, 0.05, 0.05, 0.5, 1.0, 1.0, 2.0, 10.0, 50.0]
    np.testing.assert_allclose([_round_step(value) for value in values], wanted)
