"""``python -m rsenf.cli``: the same as the command ``rsenf``."""

import sys

from rsenf.cli import main

sys.exit(main())
