"""Emulators: devices at the level of their bytes, with wire time and faults, on a pty or a CAN bus."""
