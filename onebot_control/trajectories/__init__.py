"""What moves the joints of an arm: trajectories, goals, tolerances, a follower. No ROS here."""
