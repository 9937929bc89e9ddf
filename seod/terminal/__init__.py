"""What a person sees on a terminal: consoles, questions, tables and bars of progress."""
