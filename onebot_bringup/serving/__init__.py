"""What servers on this computer share: ports, connections, origins, and the proxy of Rerun."""
