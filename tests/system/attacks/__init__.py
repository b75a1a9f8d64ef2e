"""The attack matrix: `python -m tests.system.attacks`."""
