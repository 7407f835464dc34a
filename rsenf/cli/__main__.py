"""``python -m rsenf.cli``: runs the command ``rsenf``."""

from rsenf.cli import command

command()
