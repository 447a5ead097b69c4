"""Point clouds as arrays, as the package sensor_msgs_py has them: see ``point_cloud2``."""
