"""Motions from a diffusion model of the user's: trajectory -> HumanML3D features -> joints -> SMPL rotations.

Importing this package loads no torch; `readygo.services.animator.priormdm.source` does.
"""
