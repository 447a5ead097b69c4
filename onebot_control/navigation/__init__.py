"""Navigation: mapping with scans, localization, planning and path following, without ROS."""
