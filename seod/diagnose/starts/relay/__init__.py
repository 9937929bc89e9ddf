"""Where fits of a relay's recordings begin: plants of a grid, simulated from rest."""
