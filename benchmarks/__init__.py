"""Figures of the running product; each module is a command."""
