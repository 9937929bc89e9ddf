"""What a simulation gets wrong, why, and what it gains to put it in."""

from seod import callable_room

callable_room(__name__)
