"""Replays recordings through predictors as a master would have met them, and scores what they said."""
