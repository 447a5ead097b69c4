"""Recordings as rosbag2 has them: a folder with an MCAP file and metadata.yaml."""
