"""The elements of a URDF, their readers, and the files that they name."""
