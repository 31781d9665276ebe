"""A robot with known errors and its noisy readings; the paper's studies."""
