"""Local acts at a daemon: its control socket, the emergency stop, clearing, and its audit log."""
