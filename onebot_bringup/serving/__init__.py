"""What the servers of pages share: ports on this computer, HTTP in a thread, the proxy of Rerun."""
