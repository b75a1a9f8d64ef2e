"""Transports of payloads from one daemon to the other: Zenoh, memory, and what may be injected between."""
