"""The limit cycle: its half cycles as measured, its closed form, and the estimators that invert it."""
