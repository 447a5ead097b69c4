"""What the robot view draws: each display is one file with its settings, topics and layout."""
