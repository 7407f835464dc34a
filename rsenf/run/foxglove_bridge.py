"""What travels on the bus, live in Foxglove: a WebSocket server that it connects to."""

from __future__ import annotations

from collections.abc import Callable
from types import TracebackType
from typing import Any

from rsenf.errors import RsenfError, UsageError
from rsenf.messages import Frame, Mark, VideoPacket, descriptor_set, schema_name
from rsenf.record import foxglove as forms
from rsenf.record.timeline import Timeline

PROTOBUF = "protobuf"


class FoxgloveBridge:
    """A server for Foxglove. To be used from one thread, and closed.

    Pictures go by Foxglove's own schemas, everything else by rsenf's, as in a recording. Frames,
    which are descriptors of what is elsewhere, are left out. Who doesn't keep up loses the oldest
    messages; nobody on the bus is made to wait.

    Parameters
    ----------
    host : str
        Address to listen at: ``127.0.0.1`` is this host alone.
    port : int
        Port; 0 for any that is free.
    name : str
        What Foxglove calls the connection.
    clock_ns : callable
        Wall clock, UTC since 1970, in ns.

    Raises
    ------
    UsageError
        When the package ``foxglove-sdk`` isn't installed.
    RsenfError
        When nothing can be opened there.
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

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._server.stop()

    def send(self, topic: str, message: Any, payload: bytes) -> None:
        """Show a message as it came from the bus."""
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
            described = forms.descriptor_set(schema) if forms.knows(schema) else descriptor_set()
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
