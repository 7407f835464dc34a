"""Regression: every stage run again on its recorded input, and compared with its recorded output.

The parts, in the order of the work: ``plan`` (which stages a recording can be asked for, with the
settings that are in it), ``history`` (what a stage was given beside messages), ``pictures``
(recorded video back to frames), ``rerun`` (each stage fed with its recorded input), ``tolerance``
and ``fields`` (what counts as moved), ``verdict`` (what did), ``versions`` (whether bits can be
expected to agree) and ``accept`` (record the outputs anew, with a reason).
"""

from rsenf.regress.accept import accept
from rsenf.regress.rerun import regress
from rsenf.regress.verdict import Regression, TopicVerdict

__all__ = ["Regression", "TopicVerdict", "accept", "regress"]
