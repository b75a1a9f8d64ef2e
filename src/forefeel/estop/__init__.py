"""Local acts at a daemon: its control socket, the emergency stop, and clearing."""
