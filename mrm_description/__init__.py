"""What MRM, my robotic manipulator, is."""
