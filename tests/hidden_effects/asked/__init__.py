"""Benches that can be moved again: a poor first recording, the motion that is asked for, the answer to it."""
