"""What needs root, namespaces, faults, attacks or minutes: `make system`."""
