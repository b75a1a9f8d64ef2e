/* Five experts, recursive least squares in information form; equations and table: ../estimation/experts.py. */

/* Every sum here is in the order of its index, so that each compiler gives the same bits. Where a sum would be the
   inner loop, which then could not use wide registers without fast math, all sums of a row grow side by side. */

static const int BEGIN[] = {PAST, PAST, 0, 0, 1}, END[] = {STEP, ROW, STEP, COUNT, FIRST_RELAXATION};
/* Moments by expert: 0 of f(t) - f(s), 1 of f - f0. */
static const int LEVEL[] = {0, 0, 0, 1, 1};
static const double RHO_S[] = {0.05, 0.05, 0.03, 0.05, 0.05};

/* g of a column of u. */
static double share(int column) {
    int j = column;  /* of phi */
    if (column >= STEP)
        j = column - STEP + 1;
    else if (column >= HELD)
        return 1.0;
    else if (column >= THEN)
        j = column - THEN + 1;
    if (j == 0)
        return 0.001;  /* a bias is nearly always there */
    if (j >= FIRST_NONLINEAR)
        return 3.0;
    return j == 2 || j == 3 || j >= FIRST_DIFFERENCE ? 0.1 : 1.0;
}

/* Sets the part of u that the motion gives, at ring places `now` and `newest`; held_n: f(s) - f0. */
static void fill_row(double *row, const Bank *bank, int now, int newest, double held_n) {
    const double *phi = bank->phi[now], *then = bank->phi[newest];
    for (int j = 0; j < COUNT; j++)
        row[j] = phi[j];
    for (int j = 1; j < COUNT; j++)
        row[THEN + j - 1] = then[j];
    row[HELD] = held_n;
    for (int j = 0; j < ROW - STEP; j++)
        row[STEP + j] = phi[1 + j] - then[1 + j];
}

/* Sets the columns of a stop whose radius has changed to 0. */
static void clear_stop(double (*rows)[ROW], int count, int stop) {
    int k = FIRST_STOP + stop;
    for (int i = 0; i < count; i++)
        rows[i][k] = rows[i][THEN + k - 1] = rows[i][STEP + k - 1] = 0.0;
}

/* Sets every expert's force in N; held_n: f(s), level_n: f0; largest |y| so far of both levels. */
static void predict_experts(double *experts_n, const double (*theta)[ROW], const double *row, double held_n,
                            double level_n, double largest_step_n, double largest_n) {
    const double STEP_REACH = 1.3, ODD_REACH = 2.0;
    for (int e = 0; e < EXPERTS; e++) {
        int shift = e == ODD ? STEP - 1 : 0;
        double change_n = 0.0;
        for (int j = BEGIN[e]; j < END[e]; j++)
            change_n += theta[e][j] * row[shift + j];
        double reach_n = STEP_REACH * largest_step_n;
        if (LEVEL[e] == 1)
            reach_n = (e == ODD ? ODD_REACH : STEP_REACH) * largest_n;
        experts_n[e] = (e == PLAIN ? level_n : held_n) + within(-reach_n, reach_n, change_n);
    }
}

/* Fades R and both r by `keep`, and adds the row with weight h. */
static void add(Learning *learning, const double *restrict row, double step_n, double force_n, double h,
                double keep) {
    for (int i = 0; i < ROW; i++) {
        double weighted = h * row[i], *restrict information = learning->information[i];
        learning->moments[0][i] = keep * learning->moments[0][i] + weighted * step_n;
        learning->moments[1][i] = keep * learning->moments[1][i] + weighted * force_n;
        for (int j = 0; j <= i; j++)
            information[j] = keep * information[j] + weighted * row[j];
    }
}

/* What is added to R_ii for expert e: its ridge, and what rounding may have taken. */
static double ridge(int e, int i, double size, double weight_s) {
    const double LEAST_STOP = 0.3, JITTER = 1e-10;
    double usual = size / weight_s;
    if (FIRST_STOP <= i && i < FIRST_RELAXATION)  /* a new stop has hardly any history */
        usual = most(usual, LEAST_STOP);
    return RHO_S[e] * share(i) * usual + JITTER * size + TINY;
}

/* Solves for theta of expert e, by the Cholesky factor L of R + D within its range of u. Row i of `factor` has row
   i of L up to the diagonal, and column i of L to the right of it: both are read in the order of memory. */
static void solve_expert(Learning *learning, int e) {
    int begin = BEGIN[e], end = END[e];
    double *theta = learning->theta[e], *y = learning->solution;
    for (int i = begin; i < end; i++) {
        double *restrict row = learning->factor[i], size = learning->information[i][i];
        for (int j = begin; j <= i; j++)
            row[j] = learning->information[i][j];
        for (int j = begin; j < i; j++) {
            double *restrict other = learning->factor[j], l = row[j] / other[j];
            row[j] = other[i] = l;
            for (int k = j + 1; k <= i; k++)
                row[k] -= l * other[k];
        }
        row[i] = sqrt(most(row[i] + ridge(e, i, size, learning->weight_s), 1e-14 * size + TINY));
    }
    for (int i = begin; i < end; i++)
        y[i] = learning->moments[LEVEL[e]][i];
    for (int i = begin; i < end; i++) {
        const double *restrict column = learning->factor[i];
        double solved = y[i] /= column[i];
        for (int j = i + 1; j < end; j++)
            y[j] -= column[j] * solved;
    }
    for (int i = end - 1; i >= begin; i--) {
        const double *restrict row = learning->factor[i];
        theta[i] = y[i] /= row[i];
        for (int j = begin; j < i; j++)
            y[j] -= row[j] * theta[i];
    }
}

static void solve(Learning *learning) {
    for (int e = 0; e < EXPERTS; e++)
        solve_expert(learning, e);
}

/* Adds a force of h seconds as step_n = f(t) - f(s) and force_n = f - f0; solves every 20 ms. */
static void learn_experts(Learning *learning, const double *row, double stamp_s, double step_n, double force_n,
                          double h) {
    const double MEMORY_S = 120.0, SOLVE_EVERY_S = 0.02;
    double keep = exp(-h / MEMORY_S);
    add(learning, row, step_n, force_n, h, keep);
    learning->weight_s = learning->weight_s * keep + h;
    if (stamp_s - learning->solved_s >= SOLVE_EVERY_S) {
        solve(learning);
        learning->solved_s = stamp_s;
    }
}

/* Takes over the radii; clears what was learned of stops whose radius has changed. */
static void renew_stops(Learning *learning, const double *radii_m) {
    for (int j = 0; j < STOPS; j++)
        if (learning->radii_m[j] != radii_m[j]) {
            learning->radii_m[j] = radii_m[j];
            int k = FIRST_STOP + j;
            clear_stop(learning->information, ROW, j);
            fill(0.0, learning->information[k], ROW);
            fill(0.0, learning->information[THEN + k - 1], ROW);
            fill(0.0, learning->information[STEP + k - 1], ROW);
            clear_stop(learning->moments, 2, j);
            clear_stop(learning->theta, EXPERTS, j);
        }
}

/* Reduces the weight of what was learned to 0.2 s: enough to begin with, little against new forces. */
static void discount_experts(Learning *learning) {
    const double KICK_S = 0.2;
    double share = KICK_S / most(KICK_S, learning->weight_s);
    scale(share, learning->information[0], ROW * ROW);
    scale(share, learning->moments[0], 2 * ROW);
    learning->weight_s *= share;
}
