"""Parameters of YAML files and ROS nodes, as checked values."""
