"""`seod init`: from what is on a bus or a line to a commented rig file; limits are never guessed."""
