"""Files: those that users name, those that are damaged, those that come with seod."""
