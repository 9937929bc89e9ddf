"""A fleet of rigs by MQTT: what a rig tells of itself, what is stored meanwhile, and who listens."""
