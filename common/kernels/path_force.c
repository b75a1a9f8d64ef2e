/* Force by place along the path; equations: ../estimation/path_force.py. */

/* phi' W phi and phi' W f, each zero before, of rows at `places` in steps from the first node. A row has a share in the
   node before it and one in the node after it, and both times the direction s. */
void path_normal_equations(const double *places, const double *s, const double *f, const double *w, double *gram,
                           double *moments, long n) {
    double squares[3][2][2][NODES] = {0}, products[2][2][NODES] = {0}; /* by power of s, share, other share, node */
    for (long i = 0; i < n; i++) {
        long node = (long)within(0.0, NODES - 2, places[i]);
        double after = places[i] - node, shares[] = {1.0 - after, after};
        double powers[] = {w[i], w[i] * s[i], w[i] * square(s[i])};
        for (int p = 0; p < 3; p++)
            for (int a = 0; a < 2; a++) {
                double weighted = powers[p] * shares[a];
                if (p < 2)
                    products[p][a][node] += weighted * f[i];
                for (int b = 0; b < 2; b++)
                    squares[p][a][b][node] += weighted * shares[b];
            }
    }
    for (int p = 0; p < 2; p++)
        for (int a = 0; a < 2; a++)
            for (int node = 0; node < NODES - 1; node++) {
                long row = p * NODES + node + a;
                moments[row] += products[p][a][node];
                for (int q = 0; q < 2; q++)
                    for (int b = 0; b < 2; b++)
                        gram[row * 2 * NODES + q * NODES + node + b] += squares[p + q][a][b][node];
            }
}
