"""Grippers: the port and its adapters."""
