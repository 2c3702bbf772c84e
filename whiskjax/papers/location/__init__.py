"""Liu et al. (2019) beside its simulation: tables and figures, as data, text, pictures and a page."""

_DRAWN = ("figure_6", "figure_7", "figure_8", "figure_9", "figure_10", "table_2", "estimators", "constant_errors")
FILES = ("results.json", "report.html", "figures.csv", *(f"{name}.png" for name in _DRAWN))
