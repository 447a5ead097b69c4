"""What the nodes of all packages use: topics, parameters, signals, discovery, the wire format."""
