"""What the daemon's processes share: memory, messages, how one starts another, real-time set-up."""
