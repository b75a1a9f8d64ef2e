"""`forefeel investigate`: a question, the motion that answers it, and the answer."""
