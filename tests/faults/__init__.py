"""Faults of the service on two hosts, and what is required at each. `python -m tests.faults`, as root."""
