"""Many recordings, or clips: work through them side by side, and keep what came out of each."""
