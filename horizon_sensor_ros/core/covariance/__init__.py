"""What may be wrong with a fit besides the own errors of its points, for its covariance."""
