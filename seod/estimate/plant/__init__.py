"""The plant of Eq. 1 in closed form."""
