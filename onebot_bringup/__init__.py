"""What starts, shows and steers robots."""
