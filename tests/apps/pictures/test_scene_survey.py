import numpy as np

from readygo.apps.pictures.scene_survey import COLOURS, change_picture, survey_picture
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
