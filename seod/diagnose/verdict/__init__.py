"""What was found, as the answer."""
