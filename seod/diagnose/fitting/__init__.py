"""Least squares of simulated windows to measured ones."""
