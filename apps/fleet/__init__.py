"""The fleet on this machine and the process of one worker."""
