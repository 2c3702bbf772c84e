"""A calibration for people: summary, tables, figures, page."""
