"""What a cell says of itself, for Prometheus, by a viewer in a process of its own."""
