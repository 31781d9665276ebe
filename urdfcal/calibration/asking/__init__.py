"""What the residuals of a fit say that its model lacks."""
