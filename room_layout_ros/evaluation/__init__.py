"""Measures, tables, figures and the report."""
