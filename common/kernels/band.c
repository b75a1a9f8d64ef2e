/* The 95 % band; equations and reference: ../estimation/band.py. */

static const double MISSES = 0.05;
/* The scale is at least this part of the forces' range: the best resolution of a sensor. */
static const double OF_RANGE = 1e-3;

/* Takes in the error of a prediction, with the half width and scale of its band; w: its time in s. */
static void learn_band(Band *band, double error_n, double half_n, double scale_n, double w) {
    const double MEMORY_S = 2.0, SCORES_MEMORY_S = 20.0, SCORES_SHARE = 0.25, LEAST_MEMORY_S = 0.2;
    const double SHIFT_RATE = 0.1, SHIFT_LIMIT = 2.0;
    double size_n = fabs(error_n), miss = size_n > half_n ? 1.0 : 0.0;
    band->shift = within(-SHIFT_LIMIT, SHIFT_LIMIT, band->shift + SHIFT_RATE * w * (miss - MISSES));
    band->seen_s += w;
    double memory_s = most(LEAST_MEMORY_S, SCORES_SHARE * band->seen_s);
    scale(exp(-w / least(SCORES_MEMORY_S, memory_s)), band->scores, BINS);
    double at = PER_OCTAVE * log2(size_n / scale_n + 1e-12) + ZERO_BIN;
    at = least(BINS - 1.001, most(0.0, at));
    int low = (int)at;
    band->scores[low] += w * (1.0 - at + low);
    band->scores[low + 1] += w * (at - low);
    double keep = exp(-w / least(MEMORY_S, memory_s));
    band->errors = band->errors * keep + w * size_n;
    band->weight = band->weight * keep + w;
}

/* Mean |e| of the last 2 s in N. */
static double recent_n(const Band *band) { return band->errors / (band->weight + 1e-9); }

/* log2 of the score that one in twenty exceeds. */
static double quantile(const double *scores) {
    double beyond = MISSES * sum(scores, BINS);
    int b = BINS - 1;
    while (b > 0 && beyond > scores[b])
        beyond -= scores[b--];
    double part = 0.5 - beyond / (scores[b] + 1e-200);
    return (b + part - ZERO_BIN) / PER_OCTAVE;
}

/* Half the width of the band over its scale; infinite before any error. */
static double band_factor(const Band *band) {
    /* not pow(2, .), whose last bits differ */
    return band->seen_s > 0.0 ? exp2(quantile(band->scores) + band->shift) : INFINITY;
}

/* Expected size of errors now, in N; spread_n2: variance of the experts, range_n: of the forces. */
static double band_scale_n(double recent_n, double spread_n2, double deviation_n, double range_n) {
    const double OF_SPREAD = 2.0, OF_DEVIATION = 0.05;
    double variance_n2 = recent_n * recent_n + OF_SPREAD * spread_n2 + square(OF_DEVIATION * deviation_n);
    return sqrt(variance_n2) + OF_RANGE * range_n + 1e-200;
}
