"""What is shown of target location: one target of a flight, and the study that repeats the paper."""
