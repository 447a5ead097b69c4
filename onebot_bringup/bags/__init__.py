"""Writes rosbag2 recordings, folders with an MCAP file and metadata.yaml; reads SQLite, too."""
