"""What an hour of video costs after its frames are decoded.

::

    light     rows of a wall in a lamp's light, for as many hours as are wanted
    hour      an ENF method on them: processor time and memory of an hour
    beside    every stage after the row means, beside decoding 1080p
    planes    row means with and without the mask, beside copying the plane
    trials    which of these there are, and their records
    table     records as tables
"""
