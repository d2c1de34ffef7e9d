"""Residuals and Jacobians of each kind of factor, summed into the normal equations."""
