"""Hydraulic actuators in physical units: valve, chambers, supply, load; apart from the reduced kernel."""
