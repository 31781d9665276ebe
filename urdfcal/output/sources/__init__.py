"""A calibration put into a xacro's own sources: which number feeds which origin, and the numbers replaced where they stand."""
