"""What starts MRM."""
