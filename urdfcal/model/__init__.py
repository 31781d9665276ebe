"""Which placements may be wrong and how: parameters over the chain, and Jac1."""
