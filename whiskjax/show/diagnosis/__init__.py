"""Diagnoses, told: summary, table, report."""
