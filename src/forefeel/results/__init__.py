"""`forefeel diagnose`: the command, its short answer and its page."""
