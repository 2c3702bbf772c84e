"""What people see of an answer: a summary, and tables, figures and a report made from it, by product."""
