"""Which sets of causes explain the recordings."""
