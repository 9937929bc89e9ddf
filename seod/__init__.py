"""seod: live damping ratio and natural frequency of hydraulic servo actuators from a relay limit cycle."""

__version__ = "0.1.0"
PROTOCOL = 1
"""Version of the JSON-RPC protocol; raised when a message changes incompatibly."""
