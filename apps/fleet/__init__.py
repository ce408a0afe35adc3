"""Fleets of worker processes: local, on Slurm or on several hosts, and the process of one worker."""
