"""Both daemons on one machine: two processes over Zenoh, or one process in virtual time."""
