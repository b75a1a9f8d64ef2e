"""The attack matrix: `python -m tests.attacks`."""
