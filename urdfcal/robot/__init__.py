"""A robot's description: read, walked, and written back byte by byte."""
