"""What everything stands on: errors, geometry, files, tables, the terminal. Knows no robot."""
