"""The diagnosis has to find what an independent simulation hides in recordings."""
