/* Weights of the experts by their past errors; equations and reasons: ../estimation/blend.py. */

/* Judged time in which little is known of L and of the range of the forces. */
static const double EARLY_S = 5.0;
static const double COLD = 0.1, COLD_S = 6.0;
static const double TINY = 1e-200, FLOOR = 0.003;

/* Divides the weights between the blend of the others and the two members of a taught contact. */
static void share_out(Blend *blend) {
    const double DEARER = 1.5, TRUST = 100.0, TRUST_S = 0.3;
    double floor_n2 = square(FLOOR * blend->largest_n) + TINY, shares[RIVALS], total = 0.0;
    for (int r = 0; r < RIVALS; r++) {
        shares[r] = square(square((blend->rivals_n2[0] + floor_n2) / (blend->rivals_n2[r] + floor_n2)));
        if (r > 0)
            shares[r] *= (1.0 + TRUST / (1.0 + square(blend->known_s / TRUST_S))) / square(square(DEARER));
        total += shares[r];
    }
    for (int e = 0; e < CONTACT; e++)
        blend->weights[e] *= shares[0] / total;
    for (int r = 1; r < RIVALS; r++)
        blend->weights[CONTACT + r - 1] = shares[r] / total;
}

/* Sets the weights by the losses; their sum is 1. */
static void weigh(Blend *blend) {
    const double FAST = 0.7, COLD_ERRORS = 0.1;
    int count = blend->taught > 0.0 ? CONTACT : MEMBERS;
    double *weights = blend->weights, largest_n2 = blend->largest_n * blend->largest_n;
    double known = blend->informed_n2 / (COLD_ERRORS * largest_n2 + TINY) + square(blend->known_s / COLD_S);
    double cold = COLD * COLD * largest_n2 / (1.0 + known);
    double floor_n2 = square(FLOOR) * largest_n2 + TINY, lowest = INFINITY, total = 0.0;
    for (int e = 0; e < count; e++) {
        double fast = blend->losses[0][e] / blend->seen_fast, slow = blend->losses[1][e] / blend->seen_slow;
        weights[e] = pow(fast + floor_n2, FAST) * pow(slow + floor_n2, 1.0 - FAST);
        if (e != FIRST_EXPERT + ODD)
            weights[e] += cold;
        if (e >= CONTACT)
            weights[e] += square(blend->unexplained_n) / (e == CONTACT ? 1.0 : 1.0 + square(blend->known_s / COLD_S));
        lowest = least(lowest, weights[e]);
    }
    for (int e = 0; e < count; e++) {
        weights[e] = square(square(lowest / weights[e]));
        total += weights[e];
    }
    for (int e = 0; e < count; e++)
        weights[e] /= total;
    if (blend->taught > 0.0)
        share_out(blend);
}

/* Updates losses, persistence, reach and weights by a force of h seconds, its predictions, the forces' range;
   `others_n`: the prediction without a taught contact, `residual_n`: what the contact left of the force then newest. */
static void judge_blend(Blend *blend, const double *members_n, double others_n, double residual_n, double force_n,
                        double range_n, double h) {
    const double MEMORIES_S[] = {2.0, 8.0}, CAP = 0.8, CAP_S = 10.0, REACH_S = 2.0, REACH_SHARE = 0.25, NEWEST = 0.125;
    const double PRIOR_S = 1.0;
    double error_n2 = square(force_n - members_n[ZOH]);
    double keep_fast = exp(-h / MEMORIES_S[0]), keep_slow = exp(-h / MEMORIES_S[1]);
    blend->seen_fast = blend->seen_fast * keep_fast + h;
    blend->seen_slow = blend->seen_slow * keep_slow + h;
    blend->zoh_n2 = blend->zoh_n2 * keep_slow + h * error_n2;
    blend->informed_n2 += h * error_n2;
    blend->known_s += h;
    blend->largest_n = most(blend->largest_n, sqrt(error_n2));
    double largest_n = blend->known_s < EARLY_S ? most(blend->largest_n, range_n) : blend->largest_n;
    double memory_s = least(REACH_S, REACH_SHARE * blend->known_s);
    blend->reach_n += (largest_n - blend->reach_n) * (1.0 - exp(-h / memory_s));
    double cap = square(CAP * (1.0 + blend->known_s / CAP_S)) * most(error_n2, blend->zoh_n2 / blend->seen_slow);
    for (int e = 0; e < MEMBERS; e++) {
        double loss = least(isnan(members_n[e]) ? error_n2 : square(members_n[e] - force_n), cap);
        blend->losses[0][e] = blend->losses[0][e] * keep_fast + h * loss;
        blend->losses[1][e] = blend->losses[1][e] * keep_slow + h * loss;
    }
    if (blend->taught == 0.0 && !isnan(residual_n)) {
        double prior_n2 = PRIOR_S * square(COLD * blend->largest_n) + TINY;
        blend->residual_n2 = blend->residual_n2 * keep_slow + h * square(residual_n);
        blend->persistent_n2 = blend->persistent_n2 * keep_slow + h * residual_n * (force_n - members_n[CONTACT]);
        blend->persistence =
            within(0.0, 1.0, (blend->persistent_n2 + prior_n2) / (blend->residual_n2 + prior_n2));
    }
    const double rivals_n[] = {others_n, members_n[CONTACT], members_n[CONTACT + 1]};
    double keep = exp(-h / (NEWEST * blend->known_s));
    for (int r = 0; r < RIVALS; r++) {
        double loss = isnan(rivals_n[r]) ? error_n2 : square(rivals_n[r] - force_n);
        blend->rivals_n2[r] = keep * blend->rivals_n2[r] + (1.0 - keep) * loss;
    }
    weigh(blend);
}

typedef struct { double force_n, variance_n2; int leading; } Mean;

/* Weighted mean of the first `count` predictions that are not NaN, their variance in N^2, number of the leading one. */
static Mean blend_mean(const double *weights, const double *members_n, int count) {
    double total = 0.0, force_n = 0.0, variance_n2 = 0.0;
    int leading = ZOH;
    for (int e = 0; e < count; e++)
        if (!isnan(members_n[e])) {
            total += weights[e];
            force_n += weights[e] * members_n[e];
            leading = weights[e] > weights[leading] ? e : leading;
        }
    if (total == 0.0)
        return (Mean){members_n[ZOH], 0.0, ZOH};
    force_n /= total;
    for (int e = 0; e < count; e++)
        if (!isnan(members_n[e]))
            variance_n2 += weights[e] / total * square(members_n[e] - force_n);
    return (Mean){force_n, variance_n2, leading};
}

/* Reduces the weight of past errors to a tenth. */
static void discount_blend(Blend *blend) {
    const double KICK = 0.1;
    scale(KICK, blend->losses[0], 2 * MEMBERS);
    blend->seen_fast *= KICK;
    blend->seen_slow *= KICK;
    blend->zoh_n2 *= KICK;
    blend->residual_n2 *= KICK;
    blend->persistent_n2 *= KICK;
}
