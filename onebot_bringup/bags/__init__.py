"""Writes and reads rosbag2 recordings: folders with an MCAP file and metadata.yaml."""
