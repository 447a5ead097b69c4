"""Point clouds as arrays, as in the package sensor_msgs_py; see ``point_cloud2``."""
