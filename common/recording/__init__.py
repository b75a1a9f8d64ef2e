"""Recordings: what a run wrote (MCAP), what others measured (CSV, Parquet)."""
