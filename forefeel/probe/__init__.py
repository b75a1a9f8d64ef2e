"""What can be connected, what is connected, and whether it answers."""
