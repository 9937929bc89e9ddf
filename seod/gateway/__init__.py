"""The gateway process: serves the clients. Never holds up the loop."""
