"""The numeric kernels: a library in C, its records as numpy has them, its header and its build."""
