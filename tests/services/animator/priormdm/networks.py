"""Small networks of the release's shape."""

import torch

from readygo.services.animator.priormdm.network import Mdm, NetworkShape

SMALL = NetworkShape(layers=2, latent_dim=32, ff_size=48, num_heads=4)
ARGS = {
    "arch": "trans_enc",
    "dataset": "humanml",
    "layers": 2,
    "latent_dim": 32,
    "ff_size": 48,
    "emb_trans_dec": False,
    "diffusion_steps": 50,
    "noise_schedule": "cosine",
    "sigma_small": True,
    "inpainting_mask": "root_horizontal",
}


def random_network(shape=SMALL, seed=0):
    torch.manual_seed(seed)
    return Mdm(shape).eval().requires_grad_(False)
