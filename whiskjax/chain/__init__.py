"""The imaging chain: an instrument is a list of links, and a link is a function from a shot to a pose."""
