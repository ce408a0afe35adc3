"""An avatar that is drawn fast."""

import dataclasses

import numpy as np

from readygo.common.avatars import Avatar, load_avatars


def coarse_avatar() -> Avatar:
    """An embedded avatar of few, large Gaussians."""
    body = load_avatars()["amara"]
    rows = np.arange(0, len(body.cloud), 30)
    cloud = body.cloud.select(rows)
    cloud = dataclasses.replace(cloud, scales_m=cloud.scales_m * np.float32(5.0))
    return dataclasses.replace(body, cloud=cloud, lbs_index=body.lbs_index[rows], lbs_weight=body.lbs_weight[rows])
