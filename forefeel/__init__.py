"""The command line, the loopback that starts both daemons on one machine, and the report of a run."""
