"""A located target for people: summary, tables, figures, page."""
