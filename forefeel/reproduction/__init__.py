"""The command `forefeel reproduce`: makes the bench recordings, draws, writes the page."""
