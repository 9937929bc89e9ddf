"""What the recordings are: their windows, noise and defects."""
