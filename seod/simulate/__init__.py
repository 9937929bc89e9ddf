"""`seod simulate`: a recording from the plant of a rig file, without a loop or a bus."""

from seod import callable_room

callable_room(__name__)
