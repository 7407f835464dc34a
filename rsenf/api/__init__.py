"""What rsenf does with recordings, as functions that the command line, batch and bench call.

One file each: ``track``, ``idle``, ``camera``, ``verify``, ``live``, ``discover``, ``simulate`` and
``recordings``; ``references`` opens what they compare with, ``shared`` has what all of them share.
They are ``rsenf.track`` and so on; nothing is imported before it is asked for.
"""
