/* The haptic loop's side of the predictor: ../estimation/evaluator.py. */

/* Adds a sample and its phi. */
void evaluator_move(Evaluation *evaluation, const OwnMotion *motion) {
    Bank *bank = &evaluation->bank;
    if (!advance(bank, motion->t_s, motion->x_m))
        return;
    fill_phi(bank);
    long n = (long)bank->count - 1;
    int i = place(n);
    evaluation->force_n[i] = NAN;
    evaluation->stage[i][0] = motion->stage_m;
    evaluation->stage[i][1] = motion->v_m_s;
    evaluation->stage[i][2] = motion->a_m_s2;
    evaluation->contact_n[i] = motion->contact_n;
    evaluation->steadily_n[i] = motion->steadily_n;
    if (!isnan(motion->taught_n))
        evaluation->taught_n = most(evaluation->taught_n, fabs(motion->taught_n));
    if (evaluation->newest >= 0.0 && n - evaluation->newest >= RING)
        evaluation->newest = -1.0;
}

/* Makes a force the newest, if it is later; without a motion, later by a gap than one with a motion. */
static void hold(Evaluation *evaluation, double stamp, double force_n) {
    long n = find(&evaluation->bank, stamp);
    double paired_s = evaluation->newest >= 0.0 ? evaluation->newest_s : -INFINITY;
    if (stamp <= evaluation->newest_s || (n < 0 && stamp <= paired_s + GAP_S))
        return;
    evaluation->newest_s = stamp;
    evaluation->held_n = force_n;
    evaluation->newest = evaluation->forces.known >= FIRST_FORCES ? (double)n : -1.0;
    int at = place((long)evaluation->received);
    evaluation->received_s[at] = stamp;
    evaluation->received_n[at] = force_n;
    evaluation->received += 1.0;
}

/* Passes a force to `admit` and holds those it accepts; ignores one no later than the newest. */
void evaluator_receive(Evaluation *evaluation, const Reading *reading) {
    Forces *forces = &evaluation->forces;
    if (reading->stamp_s <= evaluation->newest_s)
        return;
    double before = forces->known;
    int count = admit(forces, reading->stamp_s, reading->force_n);
    if (before < FIRST_FORCES && forces->known == FIRST_FORCES) {  /* what was held before may be far out */
        evaluation->held_n = forces->first_n;
        evaluation->newest_s = -INFINITY;
        evaluation->received = 0.0;
    }
    for (int k = 0; k < count; k++)
        hold(evaluation, forces->admitted[k][0], forces->admitted[k][1]);
}

/* Sets row u and the predictions of sample n; those of a contact not taught stay near the range. */
static void predict_members(Evaluation *evaluation, const Learned *learned, long n, double *members_n) {
    int i = place(n), j = place((long)evaluation->newest);
    double held_n = evaluation->held_n, *row = evaluation->rows[i], *known_row = evaluation->known_row[0];
    const Forces *forces = &evaluation->forces;
    fill_row(row, &evaluation->bank, i, j, held_n - learned->first_n);
    for (int k = 0; k < LAGS; k++) {
        long past = last_until(evaluation->received_s, (long)evaluation->received, evaluation->newest_s - LAGS_S[k]);
        row[PAST + k] = held_n - evaluation->received_n[place(past)];
    }
    memcpy(known_row, row, sizeof evaluation->known_row);
    for (int k = 0; k < STOPS; k++)  /* what was learned with another radius says nothing of this stop */
        if (learned->radii_m[k] != evaluation->bank.radii_m[k])
            clear_stop(evaluation->known_row, 1, k);
    members_n[ZOH] = held_n;
    double largest_n = most(learned->high_n - learned->first_n, learned->first_n - learned->low_n);
    predict_experts(members_n + FIRST_EXPERT, learned->theta, known_row, held_n, learned->first_n,
                    learned->largest_n, largest_n);
    members_n[CONTACT] = evaluation->contact_n[i];
    double residual_n = held_n + evaluation->steadily_n[i] - evaluation->steadily_n[j] - evaluation->contact_n[i];
    members_n[CONTACT + 1] = evaluation->contact_n[i] + learned->persistence * residual_n;
    evaluation->residual_n[i] = residual_n;
    double range_n = forces->high_n - forces->low_n;
    for (int e = CONTACT; e < MEMBERS; e++)
        if (learned->taught == 0.0 && !isnan(members_n[e]))
            members_n[e] = within(forces->low_n - range_n, forces->high_n + range_n, members_n[e]);
}

/* Cuts a prediction to the reach about the newest force, see blend.py, and to near the range of forces. Gives the
   hold if it is not finite. */
static double limited(const Learned *learned, const Forces *forces, double force_n, double held_n) {
    /* distance of a prediction beyond the range of the forces, over that range */
    const double BEYOND = 0.1, EARLY_BEYOND = 1.0;
    double beyond = learned->known_s < EARLY_S ? EARLY_BEYOND : BEYOND;
    double beyond_n = beyond * (forces->high_n - forces->low_n);
    force_n = within(held_n - learned->reach_n, held_n + learned->reach_n, force_n);
    force_n = within(forces->low_n - beyond_n, forces->high_n + beyond_n, force_n);
    return isfinite(force_n) ? force_n : held_n;
}

/* Half the width of the band: at most the largest error of the hold, at least what was cut off. */
static double half_width_n(const Learned *learned, double scale_n, double deviation_n, double range_n, double cut_n) {
    double half_n = scale_n * learned->factor;
    if (learned->largest_n > 0.0)
        half_n = least(half_n, most(learned->largest_n, fabs(deviation_n)));
    else if (!isfinite(half_n))
        half_n = range_n;
    return most(half_n, cut_n);
}

/* Predicts and records force, half width of the band, leading member; NaN before force or motion. */
void evaluator_predict(Evaluation *evaluation, const Learned *learned, Predicted *predicted) {
    /* Limit over the larger of the forces so far and those that the contact as taught predicts: right predictions
       reach 9 times the first alone, as a first push is many times the noise, and 1.2 times the larger. */
    const double MOST = 2.0;
    Forces *forces = &evaluation->forces;
    long n = (long)evaluation->bank.count - 1;
    *predicted = (Predicted){NAN, NAN, ZOH};
    if (forces->known == 0.0 || n < 0)
        return;
    if (learned->renewals != evaluation->renewals) {
        forces->low_n = learned->low_n;
        forces->high_n = learned->high_n;
        evaluation->renewals = learned->renewals;
        fill(NAN, evaluation->steadily_n, RING);  /* of a contact that was dropped */
    }
    double held_n = evaluation->held_n, range_n = forces->high_n - forces->low_n, force_n = held_n, cut_n = 0.0;
    Mean mean = {held_n, 0.0, ZOH};
    int i = place(n);
    if (evaluation->newest >= 0.0) {
        predict_members(evaluation, learned, n, evaluation->members_n[i]);
        const double *weights = learned->weights, *members_n = evaluation->members_n[i];
        double limited_n, first_n = forces->first_n;
        mean = blend_mean(weights, members_n, MEMBERS);
        if (learned->taught > 0.0) {  /* has learned where the forces have not been yet */
            double others_n = limited(learned, forces, blend_mean(weights, members_n, CONTACT).force_n, held_n);
            double shares[] = {sum(weights, CONTACT), weights[CONTACT], weights[CONTACT + 1]};
            double rivals_n[] = {others_n, members_n[CONTACT], members_n[CONTACT + 1]};
            limited_n = blend_mean(shares, rivals_n, RIVALS).force_n;
            evaluation->others_n[i] = others_n;
        } else
            limited_n = limited(learned, forces, mean.force_n, held_n);
        double largest_n = most(most(forces->high_n - first_n, first_n - forces->low_n), evaluation->taught_n);
        double most_n = MOST * largest_n;
        force_n = within(first_n - most_n, first_n + most_n, limited_n);
        cut_n = least(fabs(limited_n - force_n), most_n);
    }
    double scale_n = band_scale_n(learned->recent_n, mean.variance_n2, force_n - held_n, range_n);
    double half_n = half_width_n(learned, scale_n, force_n - held_n, range_n, cut_n);
    if (evaluation->newest >= 0.0) {
        evaluation->force_n[i] = force_n;
        evaluation->half_n[i] = half_n;
        evaluation->scale_n[i] = scale_n;
    }
    *predicted = (Predicted){force_n, half_n, mean.leading};
}
