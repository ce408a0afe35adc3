import numpy as np

from readygo.benchmarks.motion.paths import floor, s_curve
from readygo.benchmarks.motion.smpl_fit import bone_offsets
from readygo.common.avatars import load_avatars
from readygo.common.frames import yup_from_zup
from readygo.services.animator import AnimatorConfig, skeleton_of, walk
from readygo.services.animator.gait.quality import joints_of


def test_bone_offsets_find_the_lengths_of_another_body():
    avatars = load_avatars()
    avatar = avatars[min(avatars)]
    skeleton = skeleton_of(avatar)
    motion = walk(skeleton, s_curve(1.2), floor(), np.random.default_rng(0), AnimatorConfig(style_variation=0.0))
    found = bone_offsets(yup_from_zup(joints_of(motion, avatar)[1]), skeleton.offsets_m * 1.2)
    assert np.abs(found - skeleton.offsets_m).max() < 1e-3
