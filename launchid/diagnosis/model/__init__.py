"""The model that every cause is compared with: predictor, likelihood, noise levels, a6 and k1 within their
tolerance."""
