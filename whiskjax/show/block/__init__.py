"""An adjusted block for people: summary, tables, figures, page."""
