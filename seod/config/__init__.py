"""The rig file: one YAML file describes one rig."""
