"""Sweeps: arms x scenes x seeds of a command, on this machine, Slurm, Kubernetes or Ray."""
