import numpy as np

from readygo.apps.capture.panorama import face_camera, face_poses, join_faces
from readygo.services.reconstructor import panorama_rays


def test_faces_are_the_six_sides_of_a_cube_about_one_centre() -> None:
    T = np.eye(4)
    T[:3, 3] = (1.0, 2.0, 3.0)
    poses = face_poses(T)
    np.testing.assert_allclose(np.linalg.det(poses), 1.0)
    np.testing.assert_array_equal(poses[:, :3, 3], np.tile([1.0, 2.0, 3.0], (6, 1)))
    ahead = {tuple(forward) for forward in poses[:, :3, 2].astype(int)}
    assert len(ahead) == 6


def test_frames_of_360_degrees_show_each_ray_of_their_faces() -> None:
    camera = face_camera(256)
    v, u = np.mgrid[: camera.height_px, : camera.width_px] + 0.5
    rays = np.stack([(u - camera.cx_px) / camera.fx_px, (v - camera.cy_px) / camera.fy_px, np.ones_like(u)], axis=-1)
    rays /= np.linalg.norm(rays, axis=-1, keepdims=True)
    faces = [np.rint(128 + 90 * rays @ T[:3, :3].T).astype(np.uint8) for T in face_poses(np.eye(4))]
    images = list(join_faces(iter([*faces, *faces]), 256))
    assert len(images) == 2
    off = np.abs(images[1].astype(int) - np.rint(128 + 90 * panorama_rays(256)))
    assert off.max() <= 2
