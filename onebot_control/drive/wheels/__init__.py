"""The driven wheels of a robot: finding them, their round shapes, and their geometry."""
