"""What every answer of the Python interface can do: be read, drawn, tabulated, and shown in a notebook."""

from seod.answers.answer import Answer

__all__ = ["Answer"]
