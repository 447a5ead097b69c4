"""What moves OneBot."""
