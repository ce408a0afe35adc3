"""`python -m readygo` is the `readygo` command."""

from readygo.apps.cli import main

main()
