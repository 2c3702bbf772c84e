"""Where is the point that was seen: from many rays, and (later) from many looks in time."""
