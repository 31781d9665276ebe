"""Laser spots in pictures."""
