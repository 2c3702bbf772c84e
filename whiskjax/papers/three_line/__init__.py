"""Wang et al. (2018) beside its simulation: the six tables and nine figures, as data, text, pictures and a page."""

_SHEETS = ("tables.csv", "table_3.csv", "limits.csv", "figures.csv")
FILES = ("results.json", "report.html", *_SHEETS, *(f"figure_{number}.png" for number in range(6, 15)))
