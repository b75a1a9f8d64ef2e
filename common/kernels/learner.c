/* The identification task's side of the predictor: ../estimation/learner.py. */

/* Learns from the force of sample n and the predictions of it. Of the motion counts what was known at sample n: a
   later sample, which comes while forces are learned or after it, changes nothing, and a replay learns the same. */
static void learn(Knowledge *knowledge, const Evaluation *evaluation, long n, double force_n) {
    const Bank *bank = &evaluation->bank;
    const Forces *forces = &knowledge->forces;
    int i = place(n);
    const double *members_n = evaluation->members_n[i];
    double range_n = forces->high_n - forces->low_n, step_n = force_n - members_n[ZOH];
    double error_n = force_n - evaluation->force_n[i];
    double h = least(most(bank->periods_s[i], 1e-4), 0.05), row[1][ROW], radii_m[STOPS];
    memcpy(row, evaluation->rows[i], sizeof row);
    fill_radii(radii_m, bank->octaves[i]);
    if (bank->octaves[i] > knowledge->octave) {
        knowledge->octave = bank->octaves[i];
        renew_stops(&knowledge->experts, radii_m);
    }
    for (int k = 0; k < STOPS; k++) /* of a sample that comes out of order, from before the octave */
        if (radii_m[k] != knowledge->experts.radii_m[k])
            clear_stop(row, 1, k);
    if (!at_rest(bank, n)) {
        learn_experts(&knowledge->experts, row[0], bank->t_s[i], step_n, force_n - forces->first_n, h);
        judge_trial(&knowledge->trial, force_n, evaluation->force_n[i], members_n[ZOH], h);
    }
    knowledge->predicted_n2 += h * square(error_n);
    knowledge->zoh_n2 += h * square(step_n);
    judge_blend(&knowledge->blend, members_n, evaluation->others_n[i], evaluation->residual_n[i], force_n, range_n, h);
    learn_band(&knowledge->band, error_n, evaluation->half_n[i], evaluation->scale_n[i], h);
    if (changed(&knowledge->change, members_n[FIRST_EXPERT + PLAIN] - force_n, range_n, h)) {
        discount_experts(&knowledge->experts);
        discount_blend(&knowledge->blend);
    }
    /* one that is not finite makes the sum so */
    if (!(isfinite(knowledge->blend.weights[ZOH]) && isfinite(sum(knowledge->experts.theta[0], EXPERTS * ROW))))
        knowledge->trial.failed = 1.0;
}

/* Learns from a force; number of its sample, -1 if not learned from, or WORSE_THAN_NOTHING. */
long learner_take(Knowledge *knowledge, const Evaluation *evaluation, const Reading *reading) {
    const Bank *bank = &evaluation->bank;
    Forces *forces = &knowledge->forces;
    long n = find(bank, reading->stamp_s), learned = -1;
    if (n >= 0) {
        if (knowledge->taken[place(n)] == n + 1.0)
            return -1;
        knowledge->taken[place(n)] = n + 1.0;
    }
    int count = admit(forces, reading->stamp_s, reading->force_n);
    for (int k = 0; k < count; k++) {
        double stamp_s = forces->admitted[k][0];
        n = find(bank, stamp_s);
        if (n >= 0 && forces->known >= FIRST_FORCES && !isnan(evaluation->force_n[place(n)])) {
            learn(knowledge, evaluation, n, forces->admitted[k][1]);
            learned = stamp_s == reading->stamp_s ? n : learned;
        }
    }
    return knowledge->trial.failed == 0.0 ? learned : WORSE_THAN_NOTHING;
}

/* Stamp of the newest motion. */
double evaluator_moved_s(const Evaluation *evaluation) {
    return evaluation->bank.t_s[place((long)evaluation->bank.count - 1)];
}

/* Copies into `learned` what an evaluator needs, except `renewals`. */
void learner_publish(const Knowledge *knowledge, Learned *learned) {
    const Forces *forces = &knowledge->forces;
    const Blend *blend = &knowledge->blend;
    learned->known_s = blend->known_s;
    learned->largest_n = blend->largest_n;
    learned->reach_n = blend->reach_n;
    learned->first_n = forces->first_n;
    learned->low_n = forces->low_n;
    learned->high_n = forces->high_n;
    learned->recent_n = recent_n(&knowledge->band);
    learned->factor = band_factor(&knowledge->band);
    memcpy(learned->radii_m, knowledge->experts.radii_m, sizeof learned->radii_m);
    memcpy(learned->theta, knowledge->experts.theta, sizeof learned->theta);
    memcpy(learned->weights, blend->weights, sizeof learned->weights);
    learned->taught = blend->taught;
    learned->persistence = blend->persistence;
}
