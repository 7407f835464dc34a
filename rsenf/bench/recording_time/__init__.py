"""Time of recording: films made once and cut, and every matcher on every cut."""
