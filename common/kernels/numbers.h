/* Arithmetic as Python has it. */
#pragma once
#include <math.h>
#include <stdbool.h>

/* min and max of Python: the first one if both are equal or one is NaN, where fmin takes the number. */
static inline double least(double a, double b) { return b < a ? b : a; }
static inline double most(double a, double b) { return b > a ? b : a; }
static inline double within(double low, double high, double x) { return least(high, most(low, x)); }
static inline double square(double x) { return x * x; }

/* Index of sample n in a ring; right for n = -1, too, where C's % is negative. */
static inline int place(long n) { return (int)(n & (RING - 1)); }

static inline void fill(double value, double *x, int count) {
    for (int i = 0; i < count; i++)
        x[i] = value;
}

static inline void scale(double factor, double *x, int count) {
    for (int i = 0; i < count; i++)
        x[i] *= factor;
}

static inline double sum(const double *x, int count) {
    double total = 0.0;
    for (int i = 0; i < count; i++)
        total += x[i];
    return total;
}
