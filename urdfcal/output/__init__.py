"""Results as files: calibration YAML, drivers' formats."""
