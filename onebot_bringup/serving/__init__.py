"""Code that servers on this computer share: ports, connections, origins, and Rerun's proxy."""
