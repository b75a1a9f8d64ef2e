"""Faults of the service on two hosts, what is required at each. `python -m tests.system.faults`, as root."""
