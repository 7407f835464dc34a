"""Regression test: runs every stage on its recorded input and compares with its recorded output.

In: a recording with its graph. Out: a :class:`Regression`, one :class:`TopicVerdict` per stage.

Read in the order of the work: ``plan`` (the stages of a recording, what they got besides messages,
and whether results must agree bit for bit), ``rerun`` (feeds the stages), ``tolerance``
(comparison), ``verdict`` (results) and ``accept`` (records the outputs again, with a reason).
"""

from rsenf.regress.accept import accept
from rsenf.regress.rerun import regress
from rsenf.regress.verdict import Regression, TopicVerdict

__all__ = ["Regression", "TopicVerdict", "accept", "regress"]
