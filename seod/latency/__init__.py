"""How late this machine wakes programs up: measured, judged, and what to change."""
