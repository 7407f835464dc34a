"""Reads pictures from MCAP files of other programs: ROS 2 and Foxglove.

In: an MCAP file. Out: frames, or a recording of rsenf's. Read ``pictures`` first, which parses
messages into pictures; ``finder`` finds these among a file's records, names its topics, and makes
one camera an input of the one-process commands; ``stream`` makes frames of pictures, ``convert``
writes a recording.
"""
