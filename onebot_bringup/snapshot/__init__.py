"""Pictures of robots: what stands in them, and how they are framed."""
