"""`python -m jaxobs` is the command `jaxobs`."""

from jaxobs.cli import main

main()
