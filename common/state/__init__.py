"""The state folder of a daemon: audit log, flight records, local socket, and the lock on it."""
