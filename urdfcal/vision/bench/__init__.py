"""Beam directions of the laser module, measured on a bench."""
