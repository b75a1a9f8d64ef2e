"""Stages: the port and its adapters."""
