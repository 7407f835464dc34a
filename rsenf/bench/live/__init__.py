"""The live verdict on feeds that are honest and on feeds that aren't: how soon, how often falsely.

From a seed to a table, one idea a file::

    plan           which feeds there are: honest ones, and one kind of attack each
    grids          the stretch of a measured grid in whose light they are, and what is known of it
    scene          camera, lamp and clock of each
    footage        what a camera takes, and which of it a feed shows when
    estimates      its rows through the trackers, kept on the disk: the dear part
    watched        all that a monitor receives, in the order in which it comes
    rules          the live stage and the literature's correlation rule, at several limits
    correlation    that rule
    onsets         when a rule began to say that something is wrong
    trials         every rule on every feed
    fit            the limit that comes with the live stage
    table          records to rates, delays and the trade-off
    text, picture  the tables as text and as Markdown, and the trade-off drawn
"""
