"""Common parts of all nodes: topics, parameters, signals, discovery, the wire format."""
