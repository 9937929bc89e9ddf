"""What a simulation gets wrong, why, and what it gains to put it in."""
