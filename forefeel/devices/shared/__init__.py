"""What several drivers use."""
