"""The master daemon: handle, haptic loop, prediction and identification."""
