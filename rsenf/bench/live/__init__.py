"""The live verdict on honest and manipulated feeds: detection delay and false alarms.

From a seed to a table::

    plan      which feeds: honest ones, and one kind of attack each
    scene     the grid's stretch, camera, lamp and clock of a feed
    watched   footage, the feed made of it, and all messages a monitor receives, in order
    rules     the live stage and the sliding correlation on a feed, at several limits
    table     records to rates, delays and the trade-off, which is drawn; the fitted limit
"""
