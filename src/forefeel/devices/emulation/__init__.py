"""Parts that several emulated devices use."""
