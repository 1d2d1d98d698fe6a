void launchid_reset(launchid_estimator *e)
{
    memset(e, 0, sizeof *e);
$initial}

launchid_status launchid_update(launchid_estimator *e, const launchid_sample *s)
{
    if (e->busy) {
        e->count[RING_COUNT_FIRST]++;
        return LAUNCHID_BUSY;
    }
    e->busy = true;
    const int64_t code = call_push(e, s->t, s->theta, s->theta_dot, s->beta, s->theta_ddot, s->beta_cmd);
    if (code >= 0) {
        follow(e, code);
    }
    e->busy = false;
    return (launchid_status)code;
}

bool launchid_get_estimate(launchid_estimator *e, launchid_estimate *estimate)
{
    if (!e->has_estimate) {
        return false;
    }
    const double *number = e->outcome_number;
    const int64_t status = e->outcome_flag[WINDOW_STATUS];
    estimate->t_start = e->clock[RING_T_CLOSED];
    estimate->t_end = estimate->t_start + LAUNCHID_WINDOW;
    estimate->valid = status == LAUNCHID_OK;
    estimate->status = (launchid_estimate_status)status;
    estimate->a6 = number[WINDOW_A6];
    estimate->k1 = number[WINDOW_K1];
    estimate->a6_std = number[WINDOW_A6_STD];
    estimate->k1_std = number[WINDOW_K1_STD];
    estimate->a6_k1_corr = number[WINDOW_CORRELATION];
    estimate->a6_dot = number[WINDOW_A6_DOT];
    estimate->k1_dot = number[WINDOW_K1_DOT];
    estimate->a6_bound = number[WINDOW_A6_BOUND];
    estimate->k1_bound = number[WINDOW_K1_BOUND];
    estimate->condition = number[WINDOW_CONDITION];
    for (int term = 0; term < LAUNCHID_TERMS; term++) {
        for (int equation = 0; equation < 3; equation++) {
            estimate->xi[term][equation] = e->outcome_xi[term * 3 + equation];
            estimate->support[term][equation] = e->outcome_support[term * 3 + equation];
        }
    }
    estimate->rows = e->outcome_flag[WINDOW_USED];
    estimate->gaps = e->outcome_flag[WINDOW_GAPS];
    estimate->tracked = tracked(e, estimate->t_end);
    return true;
}

int64_t launchid_count(const launchid_estimator *e, launchid_status status)
{
    return e->count[RING_COUNT_FIRST + status - RING_BUSY];
}
