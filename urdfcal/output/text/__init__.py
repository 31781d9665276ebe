"""Results in the terminal and as JSON."""
