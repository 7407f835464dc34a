"""``python -m rsenf.cli``: the same as the command ``rsenf``."""

from rsenf.cli import command

command()
