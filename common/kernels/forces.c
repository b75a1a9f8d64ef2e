/* Rejection of outliers: ../estimation/forces.py. */

/* True if a force is in the range, or beyond it by at most its width; false for NaN. */
static bool within_reach(const Forces *forces, double force_n) {
    double range_n = forces->high_n - forces->low_n;
    return forces->low_n - range_n <= force_n && force_n <= forces->high_n + range_n;
}

/* Counts a force; extends the range, from the median of the first three, as far as two in a row reach. */
static void extend(Forces *forces, double force_n) {
    forces->known += 1.0;
    if (forces->known < FIRST_FORCES) {
        bool first = forces->known == 1.0;
        forces->low_n = first ? force_n : least(force_n, forces->low_n);
        forces->high_n = first ? force_n : most(force_n, forces->high_n);
        forces->before_n = force_n;
        return;
    }
    if (forces->known == FIRST_FORCES)
        forces->first_n = forces->low_n = forces->high_n = most(forces->low_n, least(forces->high_n, force_n));
    forces->low_n = least(forces->low_n, most(force_n, forces->before_n));
    forces->high_n = most(forces->high_n, least(force_n, forces->before_n));
    forces->before_n = force_n;
}

/* Takes in a force; number of those accepted now, in `admitted`: none, it, the last suspect, or both. */
static int admit(Forces *forces, double stamp, double force_n) {
    if (!(isfinite(force_n) && isfinite(stamp)) || stamp == forces->suspect_s)
        return 0;
    extend(forces, force_n);
    int count = 0;
    if (within_reach(forces, forces->suspect_n)) {
        forces->admitted[0][0] = forces->suspect_s;
        forces->admitted[0][1] = forces->suspect_n;
        count = 1;
    }
    forces->suspect_n = NAN;
    if (forces->known < FIRST_FORCES || within_reach(forces, force_n)) {
        forces->admitted[count][0] = stamp;
        forces->admitted[count][1] = force_n;
        return count + 1;
    }
    forces->suspect_s = stamp;
    forces->suspect_n = force_n;
    return count;
}
