"""A web page that shows all feeds of a bus as they are now. It looks, and changes nothing.

What is known: ``feed`` (one camera: ``enf_series``, ``row_strip``, ``spectrogram``, ``preview``),
``references``, ``node_board``, ``alarm_board``, and ``site``, which has them all and takes every
message. What a browser is told: ``session``. Over HTTP: ``app``, ``guard`` (who may ask) and
``server``. All of it is bounded: an hour, a day or a year of messages take the same memory.
"""
