"""Cost of an hour of video after its frames are decoded.

::

    beside    an ENF method on them; all stages after the row means, beside decoding 1080p
    trials    what is measured, row means beside copying a plane included, and the tables
"""
