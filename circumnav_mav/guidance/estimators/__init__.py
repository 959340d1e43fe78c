"""Samples in, what a law needs out. A new estimator is one file and one line here."""
