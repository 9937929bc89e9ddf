"""The extended model as a rig file that `seod run`, `seod rig` and `seod simulate` take as it is."""
