"""rsenf reads the electric network frequency (ENF) out of rolling-shutter video.

The rooms of the package, in the order data flows through them::

    decode -> rows -> track -> match        the signal rooms: pure, no bus, files or clocks
    messages                                what travels between them, and is recorded
    bus, config, record                     how it travels, what is wanted, what is kept
    run, report, cli                        what a person starts
"""

__version__ = "0.1.0"
