"""`forefeel driver test`: whether a driver keeps its port, on an emulator or on the device."""
