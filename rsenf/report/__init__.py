"""Presents results: JSON documents, text, PNG pictures and HTML pages. Nothing is estimated here.

In: results and messages of the other rooms. Out: plain values with stable keys (``*_json``), text
for people (``*_words``), and files.

Read ``values`` first (numbers and lines as text and JSON), then ``verdict`` (time of recording);
``camera`` (idle period too) and ``discovery`` follow. ``page`` builds every HTML page
of sections: ``recording_time`` (the forensic report), ``discovery_page`` and ``batch_page``.
``picture`` has the spectrogram and combines it with ``score_curve``, in the style of ``panels``.
``tables`` has the paper's idle tables.
"""
