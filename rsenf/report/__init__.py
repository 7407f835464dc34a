"""Presents results: JSON documents, text, PNG pictures and HTML pages. Nothing is estimated here.

In: results and messages of the other rooms. Out: plain values with stable keys (``*_json``), text
for people (``*_words``), and files.

Read ``verdict`` first (time of recording, as JSON and text); ``against``, ``camera`` (idle period
too) and ``discovery`` follow. ``picture`` has the spectrogram and combines it with ``score_curve``,
in the style of ``panels``. ``pages`` is common to the HTML pages: ``recording_time`` (the forensic
report), ``discovery_page`` and ``batch_page``. ``tables`` has the paper's idle tables, with
``tables_picture``.
"""
