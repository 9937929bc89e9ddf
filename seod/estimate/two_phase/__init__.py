"""The relay of two phases: how late the second phase's switches come, and where that takes the axis."""
