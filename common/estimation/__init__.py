"""Identification of the contact and prediction of its force: pure, time is an argument."""
