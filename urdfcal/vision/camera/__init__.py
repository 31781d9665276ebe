"""The camera: its lens, and where the screen stands before it."""
