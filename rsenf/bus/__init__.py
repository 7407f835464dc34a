"""The bus: publish-subscribe transport of messages between processes and hosts.

In: messages of :mod:`rsenf.messages`, each sent to a key such as ``rsenf/site/cam1/track``.
Out: the same messages, taken from an :class:`rsenf.bus.inbox.Inbox`: decoded, checked and in order,
with drops, gaps and duplicates counted.

Read ``keys`` (names, delivery classes) first; then ``sequence`` (envelopes and
sequence numbers), ``inbox`` (receive queue, recovery) and ``bus`` (the interface,
publisher and history); then the transport, ``zenoh_bus``. ``ring`` and ``frames`` pass luma planes
through shared memory within one host. ``inbox`` repairs a gap when a later message shows it; after
a link or a node is back, :mod:`rsenf.run.node` asks for the last ones.
"""
