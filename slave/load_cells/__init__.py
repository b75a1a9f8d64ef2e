"""Load cells: the port and its adapters."""
