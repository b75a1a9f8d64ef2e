"""The physics of contact and sensing: one file per effect, composed into models by name."""
