"""Reads pictures from MCAP files of other programs: ROS 2 and Foxglove.

In: an MCAP file. Out: frames, or a recording of rsenf's. Read ``picture`` first, then ``ros`` and
``foxglove``, which parse messages into pictures; ``finder`` finds these among a file's records,
``stream`` makes frames of them, ``cameras`` names a file's topics. ``video`` is one camera as an
input of the one-process commands, ``convert`` writes a recording.
"""
