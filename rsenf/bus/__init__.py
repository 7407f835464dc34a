"""Bus: how messages travel between processes and hosts."""
