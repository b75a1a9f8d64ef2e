"""Devices that can be connected, that are connected, and that answer."""
