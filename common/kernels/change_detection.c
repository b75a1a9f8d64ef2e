/* Checks of what was learned: ../estimation/change_detection.py. */

/* Takes in an error of w seconds of the plain expert; true after 0.5 s of over three times the usual, at most
   once in 10 s. Errors below a thousandth of range_n, the range of the forces, are usual. */
static bool changed(Change *change, double error_n, double range_n, double w) {
    const double USUAL_MEMORY_S = 30.0, NOW_MEMORY_S = 0.5, LARGE = 3.0, PATIENCE_S = 0.5, APART_S = 10.0;
    const double LARGE_OF_RANGE = 1e-3;
    double size_n = fabs(error_n);
    double usual_n = change->usual / (change->weight + 1e-9) + LARGE_OF_RANGE * range_n;
    bool large = size_n > LARGE * usual_n;
    double keep = exp(-w / USUAL_MEMORY_S), keep_now = exp(-w / NOW_MEMORY_S);
    change->usual = change->usual * keep + w * size_n;
    change->weight = change->weight * keep + w;
    change->now = change->now * keep_now + w * size_n;
    change->now_weight = change->now_weight * keep_now + w;
    change->since_s += w;
    change->clock_s = large ? change->clock_s + w : most(0.0, change->clock_s - w);
    if (change->clock_s < PATIENCE_S || change->since_s < APART_S)
        return false;
    change->clock_s = change->since_s = 0.0;
    change->usual = change->now / change->now_weight;
    change->weight = 1.0;
    return true;
}

/* Adds a force of w seconds to a trial; ends it after 2 s, `failed` if far worse than the hold. */
static void judge_trial(Trial *trial, double force_n, double predicted_n, double held_n, double w) {
    const double TRIAL_S = 2.0, FURTHER = 2.0, FURTHER_OF_RANGE = 0.2;
    trial->seconds += w;
    trial->predicted_n2 += w * square(force_n - predicted_n);
    trial->held_n2 += w * square(force_n - held_n);
    trial->low_n = least(trial->low_n, force_n);
    trial->high_n = most(trial->high_n, force_n);
    if (trial->seconds < TRIAL_S)
        return;
    double range_n = most(trial->high_n, trial->high_before_n) - least(trial->low_n, trial->low_before_n);
    double allowed_n2 = square(FURTHER) * trial->held_n2 + square(FURTHER_OF_RANGE * range_n) * trial->seconds;
    /* so that NaN fails, too */
    if (!(trial->predicted_n2 <= allowed_n2))
        trial->failed = 1.0;
    trial->low_before_n = trial->low_n;
    trial->high_before_n = trial->high_n;
    trial->seconds = trial->predicted_n2 = trial->held_n2 = 0.0;
    trial->low_n = INFINITY;
    trial->high_n = -INFINITY;
}
