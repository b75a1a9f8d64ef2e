"""The way of a message between two processes, beside that of other buses in the same run."""
