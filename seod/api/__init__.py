"""The Python interface: what `import seod` offers, and what the commands are thin shells over.

It needs nothing that only Linux has, but where a rig is excited.
"""
