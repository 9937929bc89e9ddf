"""Protocols without sockets."""
