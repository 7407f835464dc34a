"""The life cycle of a stage: fed message by message, renewed at each epoch, flushed at the end.

Every way of running rsenf uses this: a node process has a :class:`Runner` for each stage of a
camera, the one-process commands have a :class:`Pipeline` of them. So batch, live and replay
results can't differ.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
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
        Main output topic of the stage, which implies the message class.
    make_stage : callable
        Builds a new stage; called for every epoch, so that none sees two.
    inputs : int
        Number of input streams; the stage ends when all have ended. A stage with several (such as
        a reference) isn't renewed at an epoch: it keeps the reference and separates epochs itself.
    *beside : str
        Further output topics, for messages of their classes, with sequence numbers of their own.
    """

    def __init__(
        self, topic: str, make_stage: Callable[[], Stage], inputs: int = 1, *beside: str
    ) -> None:
        self.topic, self._beside = topic, beside
        self._make_stage = make_stage
        self._stage = make_stage()
        self._inputs, self._open = inputs, inputs
        self._last: dict[type[Any], Header] = {}  # of each class, and its newest frame
        self._fed: Header | None = None  # of the last input message
        self._sent: dict[str, Header] = {}  # of the last output message of each topic
        self.ended = False

    @classmethod
    def of(cls, spec: StageSpec, inputs: int) -> Runner:
        """Return a runner of a stage that has this number of inputs."""
        return cls(spec.sends[0], spec.make, inputs, *spec.sends[1:])

    def topic_of(self, message: Any) -> str:
        """Return the output topic of a message."""
        found = (topic for topic in self._beside if isinstance(message, TOPICS[topic]))
        return next(found, self.topic)

    def feed(self, message: Any) -> list[Any]:
        """Feed a message to the stage; return what it completes, and END marks when all has ended.

        Raises
        ------
        SchemaMismatch
            When the message can't follow those before it. It is skipped; the stage goes on.
        """
        header: Header = message.header
        if header.is_end:
            return self.end(header)
        last = self._last.get(type(message))
        if why := out_of_place(header, last):
            raise SchemaMismatch(why)
        self._last[type(message)] = header
        if last and header.frame_last < 0 and _origin(last) == _origin(header):
            self._last[type(message)] = replace(header, frame_last=last.frame_last)
        out = self._renew(header) if self._inputs == 1 else []
        self._fed = header
        return out + self._note(self._stage.update(message))

    def end(self, header: Header) -> list[Any]:
        """Note the end of one input; the last one flushes the stage.

        Parameters
        ----------
        header : Header
            Template of the END mark's header if the stage has had no message at all.

        Returns
        -------
        list
            The last messages and END marks; empty while other inputs are open.
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
            newest = self._sent.get(topic)
            seq = newest.seq + 1 if newest and newest.epoch == last.epoch else 0
            out.append(TOPICS[topic](header=last.numbered(seq, Mark.END)))
        return out

    def _renew(self, header: Header) -> list[Any]:
        """Flush the stage and make a new one, when this message begins another epoch."""
        fed = self._fed
        if fed is None or _origin(fed) == _origin(header):
            return []
        out = self._stage.flush()
        self._stage = self._make_stage()
        self._sent.pop(self.topic, None)
        return out

    def _note(self, messages: list[Any]) -> list[Any]:
        self._sent |= {self.topic_of(message): message.header for message in messages}
        return messages


def _origin(header: Header) -> tuple[str, int]:
    return header.run_id, header.epoch


class Branches:
    """Parallel stages of one camera, each fed with the topics that it reads.

    Parameters
    ----------
    *branches : tuple
        Input topics of a stage, and its runner.
    """

    def __init__(self, *branches: tuple[Sequence[str], Runner]) -> None:
        self._branches = [(tuple(TOPICS[t] for t in reads), runner) for reads, runner in branches]

    def feed(self, message: Any) -> list[Any]:
        """Feed the stages that read this message; return what they complete, END marks included."""
        reading = [runner for kinds, runner in self._branches if isinstance(message, kinds)]
        return [sent for runner in reading for sent in runner.feed(message)]


class Pipeline:
    """Connected stages of one camera in one process: each is fed what the others send and it reads.

    Parameters
    ----------
    stages : sequence of StageSpec
        In the order in which they are fed.
    given : sequence of str
        Topics fed from outside: ``frames``, or ``rows`` and ``reference``.
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
        """Feed a message to all stages that read it, and their outputs to the next ones."""
        for reads, runner in self._lanes:
            if topic in reads:
                for sent in runner.feed(message):
                    sent_to = runner.topic_of(sent)
                    self._tap(sent_to, sent)
                    self.feed(sent_to, sent)
