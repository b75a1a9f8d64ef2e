"""`forefeel doctor`: is this host fit to run a daemon? One module for each group of checks; in each, what
measures stands apart from what judges, and what judges is pure.
"""
