"""`forefeel resimulate`: recorded sessions through this version's prediction, and through that of then."""
