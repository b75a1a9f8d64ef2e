"""Fitness of a host and its settings to run: green, amber, red, and what to do."""
