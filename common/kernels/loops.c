/* Memories of causes over a whole recording from rest, n samples: the classes of ../causes/motion.py, each with
   its `step` for floats. */

/* s <- clip(s + u, -1, 1) */
void prandtl_element(const double *u, double *y, long n) {
    double s = 0.0;
    for (long i = 0; i < n; i++)
        y[i] = s = least(most(s + u[i], -1.0), 1.0);
}

/* du = (1 - u sgn(d)) d */
void bristle(const double *d, const double *decay, double *y, long n) {
    double u = 0.0;
    for (long i = 0; i < n; i++) {
        if (d[i] > 0.0)
            u = 1.0 - (1.0 - u) * decay[i];
        else if (d[i] < 0.0)
            u = (1.0 + u) * decay[i] - 1.0;
        y[i] = u;
    }
}

/* tau y' = u - y, y = start */
void lag(const double *u, const double *decay, double start, double *y, long n) {
    double value = start;
    for (long i = 0; i < n; i++)
        y[i] = value = u[i] + (value - u[i]) * decay[i];
}

/* y <- min(max(y, x - half), x + half) and, in `carried`, 1 or 0 */
void gap(const double *x, const double *half, const double *rest, const double *decay, double *y, double *carried,
         long n) {
    double value = 0.0;
    for (long i = 0; i < n; i++) {
        bool stays = isnan(rest[i]);
        double low = x[i] - half[i], high = x[i] + half[i];
        if (i == 0)
            value = stays ? x[i] : least(most(rest[i], low), high);
        double free = stays ? value : rest[i] + (value - rest[i]) * decay[i];
        y[i] = value = least(most(free, low), high);
        carried[i] = value == free ? 0.0 : 1.0;
    }
}

/* z'' + 2 d w z' + w^2 z = a; decay: d w, square: w^2, ec and es: e^(-d w dt) times cos and sin / w_d */
void oscillator(const double *a, const double *ec, const double *es, const double *decay, const double *square,
                double *z_out, double *w_out, long n) {
    double z = 0.0, w = 0.0;
    for (long i = 0; i < n; i++) {
        double rest = a[i] / square[i], y = z - rest;
        z = rest + (ec[i] + decay[i] * es[i]) * y + es[i] * w;
        w = (ec[i] - decay[i] * es[i]) * w - square[i] * es[i] * y;
        z_out[i] = z;
        w_out[i] = w;
    }
}

/* Way through the jaws, and that of each step: jumps, or for a jump of 0 creeps, where |force| > holding, that
   force being less by the stiffness times the way */
void slip(const double *force, const double *stiffness, const double *holding, const double *jump, const double *reach,
          const double *per_n, double *slipped, double *way, long n) {
    double total = 0.0, left = 0.0;
    for (long i = 0; i < n; i++) {
        double felt = force[i] - stiffness[i] * total, over = fabs(felt) - holding[i];
        if (left == 0.0 && over > 0.0)
            left = copysign(jump[i] != 0.0 ? jump[i] : over * per_n[i], felt);
        way[i] = least(most(left, -reach[i]), reach[i]);
        left = jump[i] != 0.0 ? left - way[i] : 0.0;
        slipped[i] = total += way[i];
    }
}
