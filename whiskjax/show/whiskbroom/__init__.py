"""Jin et al. (2024) beside its simulation: the seven tables and five figures, as data, text, pictures and a page."""
