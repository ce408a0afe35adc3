"""What every backend agrees on.

- A pixel (row v, column u) is sampled at (u + 0.5, v + 0.5).
- A Gaussian is drawn if its mean is more than `NEAR_M` in front of the camera; there is no far limit.
- Its image covariance is J W Sigma W^T J^T + `DILATION_PX2` I; J is taken at the mean's direction, clamped to
  `FOV_MARGIN` of the half image beyond the border (tan of the angle), as in 3DGS and gsplat.
- alpha = min(`ALPHA_MAX`, opacity * exp(-q/2)); below `ALPHA_MIN` it is skipped.
- Gaussians are blended in the order of their mean's depth; equal depths in any order.
- A pixel is finished once its transmittance is below `TRANSMITTANCE_MIN`. The Gaussian that brings it there is still
  drawn: 3DGS and gsplat drop it, and with it up to 1 % of a pixel's light. A backend may blend finished pixels further
  as long as neighbours in its block are not finished: that adds at most `TRANSMITTANCE_MIN` of a colour.
- The colour of a human's Gaussian is multiplied by the square root of the light that falls along its normal
  (`avatars.shading`), between `LIGHT_MIN` and `LIGHT_MAX`: light is the square of a display value.
- A human's Gaussians are sorted as if they were nearer by a lead that they have on the ground and that falls to nothing
  `FEET_M` above it (`lead_terms`): the order is that of means, and Gaussians of a floor, which reach far beyond theirs
  at a grazing view, would hide feet that stand on them. Depths of images stay what they are.

Source: Kerbl et al., 3D Gaussian Splatting for Real-Time Radiance Field Rendering, 2023.
"""

NEAR_M = 0.05
DILATION_PX2 = 0.3
FOV_MARGIN = 0.3
ALPHA_MAX = 0.99
ALPHA_MIN = 1.0 / 255.0
TRANSMITTANCE_MIN = 1e-4
LIGHT_MIN, LIGHT_MAX = 0.1, 4.0
"""A human's light is kept within these multiples of the scene's mean."""
FEET_M = 0.25
"""Height above the ground at which nothing of a human is sorted as nearer any more [m]."""
LOG2_E = 1.4426950408889634
LOG2_ALPHA_MIN = -7.994353436858858
"""Binary logarithm of `ALPHA_MIN`: kernels compare logarithms."""
