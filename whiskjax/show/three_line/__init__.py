"""What is shown of the three-line block: the study that repeats Wang et al. (2018)."""
