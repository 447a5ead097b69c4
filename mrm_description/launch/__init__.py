"""Scripts that start MRM."""
