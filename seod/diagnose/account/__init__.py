"""What a model leaves of the measured movement: what is systematic, and what does not repeat."""
