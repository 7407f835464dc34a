"""Replays any topics of a recording, at any speed and from any moment, with identical results.

In: an MCAP recording. Out: keys and messages, each when it is due. Read ``naming`` (choice of
topics) and ``tape`` (reading them in the order of time), ``pictures`` (video decoded again), then
``player`` and ``control`` (speed, loops, seeking); ``keyboard`` controls a player, ``input`` is a
replay as an input of the one-process commands.
"""
