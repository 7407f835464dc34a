"""Replay: any topic of a recording again, at any speed, from any moment, with equal results."""
