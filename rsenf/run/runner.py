"""The life of a stage: fed message by message, flushed at the end, renewed with each epoch.

Every way of running rsenf goes through here: a node process has one :class:`Runner` for each
camera, the one-process commands a :class:`Pipeline` of them. So batch, stream and replay can't
differ.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from rsenf.bus.keys import TOPICS
from rsenf.errors import SchemaMismatch
from rsenf.messages import Header, Mark
from rsenf.messages.plausible import out_of_place
from rsenf.stage import Stage, StageSpec


class Runner:
    """One stage of one camera.

    Parameters
    ----------
    topic : str
        Topic that the stage's messages go to; tells their class.
    make_stage : callable
        Builds a fresh stage. Called for every epoch, so that none mixes two.
    inputs : int
        Streams that must have ended before the stage has: 1, or 2 with a reference. A stage with
        a reference keeps it across epochs, and tells them apart by itself.
    beside : str
        Other topics that some of the stage's messages go to, by their class, with own numbers.
    """

    def __init__(
        self, topic: str, make_stage: Callable[[], Stage], inputs: int = 1, *beside: str
    ) -> None:
        self.topic, self._beside = topic, beside
        self._make_stage = make_stage
        self._stage = make_stage()
        self._inputs, self._open = inputs, inputs
        self._last: dict[type[Any], Header] = {}  # of the messages in, by what they are
        self._fed: Header | None = None  # of the last message in
        self._sent: dict[str, Header] = {}  # of the last message out, by its topic
        self.ended = False

    @classmethod
    def of(cls, spec: StageSpec, inputs: int) -> Runner:
        """Return a runner of a stage with so many inputs that there are."""
        return cls(spec.sends[0], spec.make, inputs, *spec.sends[1:])

    def topic_of(self, message: Any) -> str:
        """Return which of the stage's topics a message goes to."""
        found = (topic for topic in self._beside if isinstance(message, TOPICS[topic]))
        return next(found, self.topic)

    def feed(self, message: Any) -> list[Any]:
        """Give the stage a message; return what it completes, an END mark when all has ended.

        Raises
        ------
        SchemaMismatch
            When the message can't follow those before it. The stage goes on without.
        """
        header: Header = message.header
        if header.is_end:
            return self.end(header)
        if why := out_of_place(header, self._last.get(type(message))):
            raise SchemaMismatch(why)
        self._last[type(message)] = header
        out = self._renew(header) if self._inputs == 1 else []
        self._fed = header
        return out + self._note(self._stage.update(message))

    def end(self, header: Header) -> list[Any]:
        """One input has ended, or will never come; the last one ends the stage.

        ``header`` is what the END mark goes by when the stage has not had a single message.
        """
        self._open -= 1
        if self._open > 0 or self.ended:
            return []
        self.ended = True
        out = self._note(self._stage.flush())
        last, seq = self._fed or header, 0
        if sent := self._sent.get(self.topic):
            last, seq = sent, sent.seq + 1
        out.append(TOPICS[self.topic](header=last.numbered(seq, Mark.END)))
        for topic in self._beside:
            own = self._sent.get(topic)
            seq = own.seq + 1 if own and own.epoch == last.epoch else 0
            out.append(TOPICS[topic](header=last.numbered(seq, Mark.END)))
        return out

    def _renew(self, header: Header) -> list[Any]:
        """Finish the epoch before and start anew, when this message begins another."""
        fed = self._fed
        if fed is None or (fed.run_id, fed.epoch) == (header.run_id, header.epoch):
            return []
        out = self._stage.flush()
        self._stage = self._make_stage()
        self._sent.pop(self.topic, None)
        return out

    def _note(self, messages: list[Any]) -> list[Any]:
        self._sent |= {self.topic_of(message): message.header for message in messages}
        return messages


class Branches:
    """Stages of one camera, each fed with what it reads.

    Parameters
    ----------
    branches : sequence of tuple
        Topics that a stage reads, and its runner.
    """

    def __init__(self, *branches: tuple[Sequence[str], Runner]) -> None:
        self._branches = [(tuple(TOPICS[t] for t in reads), runner) for reads, runner in branches]

    @property
    def ended(self) -> bool:
        """Whether all stages have."""
        return all(runner.ended for _, runner in self._branches)

    def feed(self, message: Any) -> list[Any]:
        """Feed the stages that read it; return what they complete, as :meth:`Runner.feed` does."""
        reading = [runner for kinds, runner in self._branches if isinstance(message, kinds)]
        return [sent for runner in reading for sent in runner.feed(message)]


class Pipeline:
    """Stages of one camera in one process, each fed with what it reads of what the others send.

    Parameters
    ----------
    stages : sequence of StageSpec
        In the order in which they are fed.
    given : sequence of str
        Topics that are fed from outside: ``frames``, or ``rows`` and ``reference``.
    tap : callable, optional
        Called as ``tap(topic, message)`` with every message that a stage sends.
    """

    def __init__(
        self,
        stages: Sequence[StageSpec],
        given: Sequence[str],
        tap: Callable[[str, Any], None] = lambda topic, message: None,
    ) -> None:
        sent = {*given, *(topic for stage in stages for topic in stage.sends)}
        self._lanes = [
            (reads, Runner.of(stage, len(reads)))
            for stage in stages
            if (reads := [topic for topic in stage.reads if topic in sent])
        ]
        self._tap = tap

    def feed(self, topic: str, message: Any) -> None:
        """Feed a message to all that read it, and what they complete to those after them."""
        for reads, runner in self._lanes:
            if topic in reads:
                for sent in runner.feed(message):
                    sent_to = runner.topic_of(sent)
                    self._tap(sent_to, sent)
                    self.feed(sent_to, sent)
