"""`python -m apps` is the `readygo` command of a bare checkout."""

from apps.cli import main

main()
