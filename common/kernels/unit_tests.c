/* Inner kernels as the unit tests call them; inside, those are static, so that a compiler can merge them. */

void test_learn_experts(Learning *learning, const double *row, double stamp_s, double step_n, double force_n,
                        double h) {
    learn_experts(learning, row, stamp_s, step_n, force_n, h);
}
void test_solve(Learning *learning) { solve(learning); }
void test_predict_experts(double *experts_n, const double *theta, const double *row, double held_n, double level_n,
                          double largest_step_n, double largest_n) {
    predict_experts(experts_n, (const double(*)[ROW])theta, row, held_n, level_n, largest_step_n, largest_n);
}
void test_clear_stop(double *rows, int count, int stop) { clear_stop((double(*)[ROW])rows, count, stop); }
void test_renew_stops(Learning *learning, const double *radii_m) { renew_stops(learning, radii_m); }
void test_discount_experts(Learning *learning) { discount_experts(learning); }
void test_judge_blend(Blend *blend, const double *members_n, double others_n, double residual_n,
                      double force_n, double range_n, double h) {
    judge_blend(blend, members_n, others_n, residual_n, force_n, range_n, h);
}
void test_blend_mean(const double *weights, const double *members_n, double *mean) {
    Mean of = blend_mean(weights, members_n, MEMBERS);
    mean[0] = of.force_n;
    mean[1] = of.variance_n2;
    mean[2] = of.leading;
}
void test_learn_band(Band *band, double error_n, double half_n, double scale_n, double w) {
    learn_band(band, error_n, half_n, scale_n, w);
}
double test_recent_n(const Band *band) { return recent_n(band); }
double test_band_factor(const Band *band) { return band_factor(band); }
double test_band_scale_n(double recent_n, double spread_n2, double deviation_n, double range_n) {
    return band_scale_n(recent_n, spread_n2, deviation_n, range_n);
}
int test_changed(Change *change, double error_n, double range_n, double w) {
    return changed(change, error_n, range_n, w);
}
long test_find(const Evaluation *evaluation, double stamp) { return find(&evaluation->bank, stamp); }
