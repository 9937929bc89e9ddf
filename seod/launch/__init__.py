"""What `seod run` does before there is a daemon: locks, the supervisor, and a client that starts with it."""
