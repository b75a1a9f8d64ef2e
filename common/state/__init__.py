"""The state folder of a daemon: event log, flight records, local socket, and the lock on it."""
