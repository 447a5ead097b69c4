"""What a URDF consists of: its elements, how they are read, and the files that they name."""
