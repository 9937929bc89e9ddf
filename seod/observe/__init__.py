"""Rows, events and estimates: what the gateway's answers and streams are made of. Serves nobody itself."""
