"""What is shown of the three-line block: the study that repeats paper 001."""
