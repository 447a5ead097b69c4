"""Code shared by the servers on this computer: ports, connections, origins, Rerun's proxy."""
