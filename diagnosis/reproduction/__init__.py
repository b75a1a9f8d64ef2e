"""The paper reproduced, and the six things that its simulation gets wrong: pure functions of arrays and
recordings.
"""
