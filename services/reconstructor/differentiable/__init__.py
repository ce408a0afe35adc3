"""The differentiable CPU rasterizer, for training scenes and for finding camera poses.

    from readygo.services.reconstructor.differentiable.autograd import rasterize  # fast, on torch tensors
    from readygo.services.reconstructor.differentiable.reference import rasterize_with_torch  # slow oracle
    from readygo.services.reconstructor.differentiable.order import spatial_order  # sort parameters by it

Only `autograd` and `reference` import torch. It draws by the rules of `readygo.common.rasterizer.constants`; here every
single pixel is finished below `TRANSMITTANCE_MIN`.

Forward. Chunks of 256 Gaussians that follow each other in memory are bounded (`cull`), and drawn in slabs of depth,
nearest first: chunks and Gaussians behind finished pixels are skipped, the others gathered by sixteen and projected
(`project`), sorted, spread to lists of 16x16 px tiles, and blended (`blend`) with

    alpha_i = min(0.99, o_i exp(-q_i / 2)),   w_i = alpha_i T_i,   T_{i+1} = T_i - w_i,   C = sum_i w_i c_i

for any number of channels c: colour, depth, 1 (whose sum is one minus the transmittance) and features. A block of 4x4
pixels takes up to 64 entries of its tile's list at a time, in short loops one after the other: ln alpha, alpha,
weights, four channels at a time. In one loop an entry would be a chain too long for a CPU to begin the next beside it.

Backward. The lists are replayed in the same order (`blend_gradients`), entry by entry, and only in those blocks of 4x4
pixels of which the forward pass noted that the entry changed a pixel; sums over pixels are taken once per entry. With g
= dL / dC of a pixel and the suffix S_i = g . C - sum_{j <= i} w_j (c_j . g), what Gaussian i does to the loss is

    dL / dc_i = sum over pixels of w_i g,    v_i = dL / d ln(alpha_i) = w_i (c_i . g) - S_i alpha_i / (1 - alpha_i),

v_i = 0 where alpha is capped. Moments of v_i over the pixels are all that the projection needs (`project_gradients`):
these lead to covariance, quaternion, scales, mean and pose. Spherical harmonics are in `colour`.

Memory. A frame keeps lists and projections until its backward pass is over; frames, images and gradients are used again
when they are dropped (`pool`). Gradients for 500,000 Gaussians of SH degree 3 take 100 MB, most of them zero: ask for
sparse ones.

Sources: Kerbl et al., 3D Gaussian Splatting for Real-Time Radiance Field Rendering, 2023; Zwicker et al., EWA
splatting, 2002; Ye et al., gsplat: An Open-Source Library for Gaussian Splatting, 2024 (derivatives of the projection);
Ye et al., AbsGS, 2024 (absolute gradients).
"""
