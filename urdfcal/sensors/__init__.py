"""What is measured: sensors with their Jac2, readings, and the measurements file."""
