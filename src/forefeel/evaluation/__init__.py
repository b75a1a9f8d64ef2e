"""`forefeel evaluate`: the command and its page."""
