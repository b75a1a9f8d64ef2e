"""The paper reproduced by its own algorithm, and the six things that its simulation gets wrong: `forefeel
reproduce`.
"""
