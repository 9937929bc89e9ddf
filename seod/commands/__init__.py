"""The commands of `seod`, by what they work on; `seod.cli` puts them together."""
