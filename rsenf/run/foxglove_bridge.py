"""Live bridge from the bus to Foxglove: a WebSocket server that Foxglove connects to."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rsenf.errors import RsenfError, UsageError
from rsenf.messages import Frame, Mark, VideoPacket, schema_name
from rsenf.record import topics as forms
from rsenf.record.sequence import Timeline

PROTOBUF = "protobuf"


class FoxgloveBridge:
    """A WebSocket server for Foxglove. A context manager; use it from one thread.

    Compressed pictures use Foxglove's schemas, everything else rsenf's, as in a recording. Frame
    messages are left out: they only describe pixels held elsewhere. A client that is too slow
    loses the oldest messages; it exerts no backpressure on the bus.

    Parameters
    ----------
    host : str
        Address to listen at; ``127.0.0.1`` is reachable from this host only.
    port : int
        Port; 0 chooses a free one.
    name : str
        Name of the connection in Foxglove.
    clock_ns : callable
        Wall clock, UTC since 1970, in ns.

    Raises
    ------
    UsageError
        When the package ``foxglove-sdk`` isn't installed.
    RsenfError
        When the server can't listen there.
    """

    def __init__(self, host: str, port: int, name: str, clock_ns: Callable[[], int]) -> None:
        self._library = _library()
        self._context = self._library.Context()
        self._channels: dict[tuple[str, str], Any] = {}
        self._timeline = Timeline(clock_ns)
        try:
            self._server = self._library.start_server(
                name=name, host=host, port=port, context=self._context
            )
        except Exception as exc:
            raise RsenfError(f"can't serve at {host}:{port}: {exc}", "choose another port") from exc
        self.port = int(self._server.port)

    def __enter__(self) -> FoxgloveBridge:
        return self

    def __exit__(self, *error: object) -> None:
        self._server.stop()

    def send(self, topic: str, message: Any, payload: bytes) -> None:
        """Forward a message from the bus.

        Parameters
        ----------
        topic : str
            Its key.
        message : object
            The decoded message.
        payload : bytes
            The bytes it came in.
        """
        header = message.header
        if isinstance(message, Frame):
            return
        log_time_ns = self._timeline.log_time_ns(type(message), header)
        schema = schema_name(type(message))
        if isinstance(message, VideoPacket):
            picture = None if header.mark != Mark.DATA else forms.to_foxglove(message, log_time_ns)
            if picture is None:
                return
            schema, payload = picture.schema, picture.payload
        self._channel(topic, schema).log(payload, log_time=log_time_ns)

    def _channel(self, topic: str, schema: str) -> Any:
        known = self._channels.get((topic, schema))
        if known is None:
            described = forms.descriptor_set_of(schema)
            known = self._channels[topic, schema] = self._library.Channel(
                topic,
                message_encoding=PROTOBUF,
                schema=self._library.Schema(name=schema, encoding=PROTOBUF, data=described),
                context=self._context,
            )
        return known


def _library() -> Any:
    try:
        import foxglove
    except ImportError as exc:
        raise UsageError(
            "the Foxglove bridge needs the package foxglove-sdk", "pip install 'rsenf[foxglove]'"
        ) from exc
    return foxglove
