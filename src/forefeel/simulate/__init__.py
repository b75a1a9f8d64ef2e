"""`forefeel simulate`: a recording of any model, as a load cell and an encoder would have made it."""
