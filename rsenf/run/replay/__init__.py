"""Replays any topics of a recording, at any speed and from any moment, with identical results.

In: an MCAP recording. Out: keys and messages, each when it is due. Read ``tape`` (choice of topics,
and reading them in the order of time), ``pictures`` (video decoded again), then ``player`` and
``control`` (speed, loops, seeking, the keyboard).
"""
