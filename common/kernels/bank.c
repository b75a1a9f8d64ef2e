/* The recent motion and its regressors phi; the table of them: ../estimation/bank.py. */

static const double SPEED_MEMORY_S = 20.0, FASTEST_MEMORY_S = 60.0, REACH = 10.0, REST_S = 2.0;
/* The stop whose hysteresis relaxes and meets the nonlinear terms: radius 1/32 to 1/64 of the range. */
enum { RELAXATION_STOP = 5 };

/* Starts a piece at sample n: resets stops and means; speed and acceleration stay. */
static void begin_piece(Bank *bank, long n, double t, double x) {
    bank->start = n;
    bank->began_m = bank->median_m = bank->rest_m = x;
    bank->moved_s = t;
    fill(0.0, bank->stops_m, STOPS);
    fill(x, bank->slow_m, RELAXATIONS);
    fill(0.0, bank->slow_friction, RELAXATIONS);
}

/* Sets origin, range and fastest speed from the first three samples; a piece starts at their median. */
static void begin_range(Bank *bank, long n, double t, double x) {
    double one = fabs(x - bank->median_m), two = fabs(bank->x_m[place(n - 1)] - bank->median_m);
    double zero = fabs(bank->x_m[place(n - 2)] - bank->median_m);
    bank->fastest_m_s = (one + two + zero - most(most(one, two), zero)) / bank->period_s;
    bank->origin_m = bank->low_m = bank->high_m = bank->median_m;
    bank->speed2 = bank->speed_s = 0.0;
    begin_piece(bank, n, t, bank->median_m);
}

/* x, or the last position if x is out of reach; again x if the next confirms it, a new piece if far. */
static double accepted(Bank *bank, long n, double x, double dt) {
    double before = bank->x_m[place(n - 1)];
    double jump = fabs(x - before), suspect = bank->suspect_m, least_s = most(dt, bank->period_s);
    bank->suspect_m = NAN;
    if (isnan(bank->origin_m) || jump <= REACH * bank->fastest_m_s * least_s)
        return x;
    if (fabs(x - suspect) < jump) {
        bank->fastest_m_s = most(bank->fastest_m_s, fabs(x - suspect) / least_s);
        bool far = jump > bank->high_m - bank->low_m || n - bank->start < 3;
        bank->restart = far ? 1.0 : 0.0;
        return x;
    }
    bank->suspect_m = x;
    return before;
}

/* Moves stops, speeds and means on by one sample. */
static void follow(Bank *bank, long n, double x, double dx, double dt) {
    bank->period_s = bank->period_s == 0.0 ? dt : bank->period_s + 0.02 * (dt - bank->period_s);
    double median = x;
    if (n - bank->start >= 2) {
        double one = bank->x_m[place(n - 1)], two = bank->x_m[place(n - 2)];
        median = most(least(x, one), least(most(x, one), two));
        bank->low_m = least(bank->low_m, median);
        bank->high_m = most(bank->high_m, median);
    }
    double moved = median - bank->median_m;
    bank->median_m = median;
    if (n - bank->start >= 3) {
        double fading = bank->fastest_m_s * exp(-dt / FASTEST_MEMORY_S);
        bank->fastest_m_s = most(fading, fabs(moved) / most(dt, bank->period_s));
    }
    for (int j = 0; j < STOPS; j++)
        bank->stops_m[j] = within(-bank->radii_m[j], bank->radii_m[j], bank->stops_m[j] + moved);
    double share = 1.0 - exp(-dt / most(2.0 * bank->period_s, 0.004));
    double before = n - bank->start > 1 ? bank->v : dx / dt;
    bank->v = before + (dx / dt - before) * share;
    bank->a += ((bank->v - before) / dt - bank->a) * share;
    bank->speed2 += bank->v * bank->v * dt;
    bank->speed_s += dt;
    if (bank->speed_s > SPEED_MEMORY_S) {
        bank->speed2 *= SPEED_MEMORY_S / bank->speed_s;
        bank->speed_s = SPEED_MEMORY_S;
    }
}

/* Gives the smallest stops the radii of the next octaves if the range has outgrown the largest. */
static void widen(Bank *bank) {
    double width = bank->high_m - bank->low_m;
    if (!(width > 0.0 && isfinite(width)) || (bank->octave != NO_OCTAVE && width <= pow(2.0, bank->octave)))
        return;
    int octave = (int)ceil(log2(width)), first = octave - STOPS + 1;
    if (bank->octave != NO_OCTAVE && (int)bank->octave + 1 > first)
        first = (int)bank->octave + 1;
    for (int j = first; j <= octave; j++) {
        int slot = j & (STOPS - 1);
        double r = ldexp(1.0, j - 1);
        bank->radii_m[slot] = r;
        bank->stops_m[slot] = within(-r, r, bank->median_m - bank->began_m);
        for (int i = 0; i < RING; i++)
            bank->phi[i][FIRST_STOP + slot] = 0.0;
    }
    bank->octave = octave;
}

/* Adds one sample, without its phi; false, unchanged, if not finite or its stamp does not increase. */
static bool advance(Bank *bank, double t, double x) {
    long n = (long)bank->count;
    int last = place(n - 1);
    if (!(isfinite(t) && isfinite(x)) || (n > 0 && t <= bank->t_s[last]))
        return false;
    double dt = t - bank->t_s[last];
    if (n > 0 && dt <= GAP_S && bank->restart == 0.0)
        x = accepted(bank, n, x, dt);
    bool new_piece = n == 0 || dt > GAP_S || bank->restart > 0.0;
    bank->restart = 0.0;
    if (new_piece)
        begin_piece(bank, n, t, x);
    else
        follow(bank, n, x, x - bank->x_m[last], dt);
    if (isnan(bank->origin_m) && n - bank->start == 2)
        begin_range(bank, n, t, x);
    widen(bank);
    /* the radius of the smallest stop, about a 256th of the range of motion; what is less counts as rest */
    double smallest_m = bank->octave == NO_OCTAVE ? 0.0 : pow(2.0, bank->octave - STOPS);
    if (fabs(x - bank->rest_m) > smallest_m) {
        bank->rest_m = x;
        bank->moved_s = t;
    }
    bank->t_s[place(n)] = t;
    bank->x_m[place(n)] = x;
    bank->periods_s[place(n)] = bank->period_s;
    bank->octaves[place(n)] = bank->octave;
    bank->since_moved_s[place(n)] = t - bank->moved_s;
    bank->count = n + 1;
    return true;
}

/* True if the motion has rested for over 2 s up to sample n, so that it teaches nothing. */
static bool at_rest(const Bank *bank, long n) {
    return bank->since_moved_s[place(n)] > REST_S && bank->octaves[place(n)] != NO_OCTAVE;
}

/* The radii of the stops in an octave. */
static void fill_radii(double *radii_m, double octave) {
    fill(1.0, radii_m, STOPS);
    for (int j = (int)octave - STOPS + 1; octave != NO_OCTAVE && j <= (int)octave; j++)
        radii_m[j & (STOPS - 1)] = ldexp(1.0, j - 1);
}

/* Moves the means of x and friction on by dt; phi gets the differences from them. */
static void fill_relaxations(Bank *bank, double *phi, double x, double friction, double dt) {
    for (int j = 0; j < RELAXATIONS; j++) {
        if (dt > 0.0) {
            double share = 1.0 - exp(-dt / RELAXATIONS_S[j]);
            bank->slow_m[j] += (x - bank->slow_m[j]) * share;
            bank->slow_friction[j] += (friction - bank->slow_friction[j]) * share;
        }
        phi[FIRST_RELAXATION + j] = x - bank->slow_m[j];
        phi[FIRST_RELAXATION + RELAXATIONS + j] = friction - bank->slow_friction[j];
    }
}

/* Sets first to third derivative of each span, by divided differences over the actual stamps. Until three spans
   fit into the piece, the next shorter span replaces them, and for its first three samples the end of the last
   piece: zeros would look like a jerk. */
static void fill_differences(Bank *bank, double *phi, long n) {
    const double *t = bank->t_s, *x = bank->x_m;
    int p0 = place(n);
    for (int j = 0; j < DIFFERENCES; j++) {
        int span = SPANS[j];
        double *to = phi + FIRST_DIFFERENCE + 3 * j;
        if (n - 3 * span < bank->start) {
            bool shorter = j > 0 && n - 3 >= bank->start;
            const double *from = shorter ? to - 3 : bank->phi[place(n - 1)] + FIRST_DIFFERENCE + 3 * j;
            for (int k = 0; k < 3; k++)
                to[k] = from[k];
            continue;
        }
        int p1 = place(n - span), p2 = place(n - 2 * span), p3 = place(n - 3 * span);
        double first0 = (x[p0] - x[p1]) / (t[p0] - t[p1]);
        double first1 = (x[p1] - x[p2]) / (t[p1] - t[p2]);
        double first2 = (x[p2] - x[p3]) / (t[p2] - t[p3]);
        double second0 = 2.0 * (first0 - first1) / (t[p0] - t[p2]);
        double second1 = 2.0 * (first1 - first2) / (t[p1] - t[p3]);
        to[0] = first0;
        to[1] = second0;
        to[2] = 3.0 * (second0 - second1) / (t[p0] - t[p3]);
    }
}

static void fill_nonlinear(double *phi, double x, double friction, double sign, double speed) {
    double *to = phi + FIRST_NONLINEAR;
    to[0] = friction * sqrt(speed);
    to[1] = friction * exp(-speed);
    to[2] = sign * speed * speed;
    to[3] = x * x;
    to[4] = x * x * x;
    to[5] = friction * x;
    to[6] = friction * x * x;
    to[7] = friction * x * x * x;
}

/* Computes phi of the newest sample, 0 before x0 is known, and moves the means of the relaxations on. */
static void fill_phi(Bank *bank) {
    long n = (long)bank->count - 1;
    int i = place(n);
    double dt = n > bank->start ? bank->t_s[i] - bank->t_s[place(n - 1)] : 0.0;
    double x = bank->x_m[i], *phi = bank->phi[i];
    if (isnan(bank->origin_m)) {
        fill(0.0, phi, COUNT);
        return;
    }
    double v_rms = bank->speed_s > 0.0 ? sqrt(bank->speed2 / bank->speed_s) : 0.0;
    double sign = v_rms > 0.0 ? tanh(bank->v / (0.1 * v_rms)) : 0.0;
    phi[0] = 1.0;
    phi[1] = x - bank->origin_m;
    phi[2] = bank->v;
    phi[3] = bank->a;
    phi[4] = sign;
    for (int j = 0; j < STOPS; j++)
        phi[FIRST_STOP + j] = bank->stops_m[j] / bank->radii_m[j];
    double friction = 0.0;
    if (bank->octave != NO_OCTAVE)
        friction = phi[FIRST_STOP + ((int)(bank->octave - RELAXATION_STOP) & (STOPS - 1))];
    fill_relaxations(bank, phi, x, friction, dt);
    fill_differences(bank, phi, n);
    double speed = v_rms > 0.0 ? least(fabs(bank->v) / v_rms, 10.0) : 0.0;
    fill_nonlinear(phi, x - bank->origin_m, friction, sign, speed);
}

/* Number of the last of `count` stamps in a ring that is no later; of the oldest if all are later. */
static long last_until(const double *stamps_s, long count, double stamp) {
    long low = count > RING ? count - RING : 0, high = count - 1;
    while (low < high) {
        long middle = (low + high + 1) / 2;
        if (stamps_s[place(middle)] <= stamp + 1e-7)
            low = middle;
        else
            high = middle - 1;
    }
    return low;
}

/* Number of the sample with that stamp, to a microsecond; -1 if it is not in the ring. */
static long find(const Bank *bank, double stamp) {
    long n = last_until(bank->t_s, (long)bank->count, stamp);
    return fabs(bank->t_s[place(n)] - stamp) < 1e-6 ? n : -1;
}
