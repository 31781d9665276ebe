"""Tests of a calibration in a xacro's own sources."""
