"""What several emulated devices use."""
