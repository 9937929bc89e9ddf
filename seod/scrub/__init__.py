"""`seod scrub`: takes the server's tokens out of recordings that were made while they were put there."""
