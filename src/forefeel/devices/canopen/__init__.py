"""CANopen, for every device on a CAN bus."""
