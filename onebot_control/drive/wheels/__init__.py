"""The driven wheels of a robot: how they are found, their round shapes, and their geometry."""
