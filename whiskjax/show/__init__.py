"""What people see of a calibration: one summary, and tables, figures and a report made from it."""
