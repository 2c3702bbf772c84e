"""Jin et al. (2024) beside its simulation: the seven tables and five figures, as data, text, pictures and a page."""

FILES = (
    "results.json",
    "report.html",
    "seeds.csv",
    *(f"table_{number}.csv" for number in range(1, 8)),
    *(f"figure_{number}.png" for number in range(3, 8)),
    "open_questions.csv",
    *(f"open_{question}.png" for question in ("weights", "drift", "blunders", "pos_errors", "covariance")),
)
