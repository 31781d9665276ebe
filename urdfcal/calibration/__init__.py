"""A robot put to its measurements: J = Jac2 Jac1, the fit, and its result."""
