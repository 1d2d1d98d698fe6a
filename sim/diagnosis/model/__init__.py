"""What the world may do without being wrong: predictor, likelihood, noise levels, a6 and k1 within their tolerance."""
