"""Pictures in the MCAP files of other programs: ROS 2 and Foxglove.

``cdr`` reads ROS 2's wire form, ``ros`` and ``foxglove`` the messages with pictures in them, each
into a ``picture``; ``finder`` finds them among a file's records; ``pixels`` makes luma of raw
ones, ``stream`` frames of all; ``cameras`` are the topics of a file, ``video`` is one as an input
and ``convert`` writes them as a recording.
"""
