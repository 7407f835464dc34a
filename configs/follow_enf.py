"""Follow the ENF of every camera on a bus, with nothing of rsenf but its published schema.

    python configs/follow_enf.py tcp/127.0.0.1:7448 configs/schema/rsenf.desc

As 'rsenf explain contract' has it: subscribes, asks for the history, drops what came twice, counts
what never came, turns away what isn't an estimate of this version, and asks again after a silence,
since a link may have been broken. Prints one JSON object a line; ends when every stream has.
"""

from __future__ import annotations

import json
import queue
import sys
from typing import Any

import zenoh
from google.protobuf import descriptor_pb2, descriptor_pool, message_factory
from google.protobuf.message import DecodeError

KEYS = "rsenf/*/*/track"
ENCODING = "application/protobuf;rsenf.EnfEstimate/1"
SILENCE_S = 5.0
END = 2


class Streams:
    """What has come of each stream: one sender's messages of one run and epoch on one key."""

    def __init__(self) -> None:
        self.seen: dict[tuple[str, ...], int] = {}
        self.missed = self.refused = 0
        self.ended: set[str] = set()

    def is_new(self, key: str, sender: str, header: Any) -> bool:
        """Take in a message's number; False when it has come before."""
        stream = (key, sender, header.run_id, str(header.epoch))
        last = self.seen.get(stream)
        if last is not None and header.seq <= last:
            return False
        if last is not None:
            self.missed += header.seq - last - 1
        self.seen[stream] = header.seq
        (self.ended.add if header.mark == END else self.ended.discard)(key)
        return True

    @property
    def all_ended(self) -> bool:
        """Whether there were streams, and each has had its END mark."""
        return bool(self.seen) and {stream[0] for stream in self.seen} == self.ended


def estimate_class(path: str) -> Any:
    """Read the schema."""
    pool = descriptor_pool.DescriptorPool()
    with open(path, "rb") as file:
        for one in descriptor_pb2.FileDescriptorSet.FromString(file.read()).file:
            pool.Add(one)
    return message_factory.GetMessageClass(pool.FindMessageTypeByName("rsenf.EnfEstimate"))


def main(endpoint: str, schema: str) -> None:
    """Follow until all has ended."""
    estimate, streams = estimate_class(schema), Streams()
    waiting: queue.Queue[Any] = queue.Queue(1000)
    config = zenoh.Config()
    config.insert_json5("mode", '"client"')
    config.insert_json5("connect/endpoints", json.dumps([endpoint]))
    with zenoh.open(config) as session:
        subscriber = session.declare_subscriber(KEYS, waiting.put)

        def catch_up() -> None:
            for reply in session.get(KEYS, consolidation=zenoh.ConsolidationMode.NONE):
                if reply.ok is not None:
                    take(reply.ok)

        def take(sample: Any) -> None:
            sender = sample.attachment.to_bytes().decode() if sample.attachment else ""
            try:
                if str(sample.encoding) != ENCODING:
                    raise DecodeError("another message, or version")
                message = estimate.FromString(sample.payload.to_bytes())
            except DecodeError:
                streams.refused += 1
                return
            key = str(sample.key_expr)
            if streams.is_new(key, sender, message.header) and message.header.mark != END:
                told = {"source": message.header.source, "enf_hz": message.enf_hz,
                        "usable": message.usable, "missed": streams.missed}  # fmt: skip
                print(json.dumps(told), flush=True)

        catch_up()
        while not streams.all_ended:
            try:
                take(waiting.get(timeout=SILENCE_S))
            except queue.Empty:
                catch_up()
        subscriber.undeclare()
    print(f"missed {streams.missed}, refused {streams.refused}", file=sys.stderr)


if __name__ == "__main__":
    main(*sys.argv[1:3])
