"""The simulated rig: plant, sensors, amplifier. Knows nothing of the daemon."""
