"""Entry point of ``python -m bokehnet``: the command line."""

from bokehnet.cli.app import main

main()
