"""Estimators and their statistics: residual, prior, noise and filter. Knows no robot."""
