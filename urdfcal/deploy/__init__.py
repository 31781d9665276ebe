"""A calibration at work: false targets for controllers that keep their nominal geometry."""
