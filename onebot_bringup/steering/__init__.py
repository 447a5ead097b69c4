"""The steering page: its node, server, protocol, access rules, and the arbiter of its drivers."""
