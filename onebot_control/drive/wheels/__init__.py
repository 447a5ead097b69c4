"""The wheels of a robot: which they are, what they roll on, and how they drive it."""
