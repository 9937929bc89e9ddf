"""How pictures look: one style for all, for eyes of any kind, on light and dark pages."""
