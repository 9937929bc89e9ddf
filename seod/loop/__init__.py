"""The loop process: one tick after another, in real time. `tick.py` is the whole of a tick, in order."""
