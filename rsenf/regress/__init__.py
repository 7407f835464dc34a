"""Regression test: runs every stage on its recorded input and compares with its recorded output.

In: a recording with its graph. Out: a :class:`Regression`, one :class:`TopicVerdict` per stage.

Read in the order of the work: ``plan`` (the stages of a recording, with its settings), ``history``
(what a stage got besides messages), ``pictures`` (recorded video to frames), ``rerun`` (feeds the
stages), ``tolerance`` and ``fields`` (comparison), ``verdict`` (results), ``versions`` (whether
results must agree bit for bit) and ``accept`` (records the outputs again, with a reason).
"""

from rsenf.regress.accept import accept
from rsenf.regress.rerun import regress
from rsenf.regress.verdict import Regression, TopicVerdict

__all__ = ["Regression", "TopicVerdict", "accept", "regress"]
