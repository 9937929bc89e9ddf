"""This computer, asked the same way on any system: processors, memory, limits."""
