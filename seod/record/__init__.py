"""Recordings: what the gateway writes of a run, and reading it back for a replay. See docs/recordings.md."""
