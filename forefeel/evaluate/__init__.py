"""`forefeel evaluate`: the command, its table and its page."""
