"""The simulated world of the slave: stage, fixture, vessel and load cell."""
