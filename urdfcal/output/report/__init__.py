"""The report: tables, plots, page."""
