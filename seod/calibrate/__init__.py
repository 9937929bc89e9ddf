"""Calibration: what to drive, what the recorded samples say, and the client that does both over TCP."""
