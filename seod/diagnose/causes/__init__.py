"""What is known of each cause."""
