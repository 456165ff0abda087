"""`python -m rotavg`."""

from rotavg.cli import main

main()
