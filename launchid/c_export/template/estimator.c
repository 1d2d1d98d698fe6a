/* ---- the estimator */

void launchid_state_reset(launchid_state *state)
{
    (void)memset(state, 0, sizeof *state);
$initial    state->state.guard.carried = $seal;
}

launchid_status launchid_state_update(launchid_state *state, launchid_work *work, const launchid_sample *s)
{
    if (state->busy == LAUNCHID_BUSY_MARK) {
        state->state.counts.answers[0]++;
        return LAUNCHID_BUSY;
    }
    state->busy = LAUNCHID_BUSY_MARK;
    $block
    int64_t code = $update;
    if (code == RING_RECOVERED) {
        int64_t kept[RING_N_STATUS];
        (void)memcpy(kept, state->state.counts.answers, sizeof kept);
        launchid_state_reset(state);
        (void)$update;
        (void)memcpy(state->state.counts.answers, kept, sizeof kept);
        code = RING_RECOVERED;
        state->state.counts.answers[RING_RECOVERED - RING_BUSY]++;
    }
    state->busy = 0;
    return (launchid_status)code;
}

bool launchid_state_estimate(launchid_state *state, launchid_work *work, launchid_estimate *estimate)
{
    if (state->state.counts.estimates == 0) {
        return false;
    }
    const LaunchidOutcome *const outcome = &state->state.outcome;
    estimate->t_start = state->state.clock.closed;
    estimate->t_end = estimate->t_start + LAUNCHID_WINDOW;
    estimate->valid = outcome->status == (int64_t)LAUNCHID_OK;
    estimate->status = (launchid_estimate_status)outcome->status;
    estimate->a6 = outcome->a6;
    estimate->k1 = outcome->k1;
    estimate->a6_std = outcome->a6_std;
    estimate->k1_std = outcome->k1_std;
    estimate->a6_k1_corr = outcome->correlation;
    estimate->a6_dot = outcome->a6_dot;
    estimate->k1_dot = outcome->k1_dot;
    estimate->a6_bound = outcome->a6_bound;
    estimate->k1_bound = outcome->k1_bound;
    estimate->condition = outcome->condition;
    for (int64_t term = 0; term < LAUNCHID_TERMS; term++) {
        for (int64_t equation = 0; equation < 3; equation++) {
            estimate->xi[term][equation] = outcome->xi[(term * 3) + equation];
            estimate->support[term][equation] = outcome->support[(term * 3) + equation] != 0;
        }
    }
    estimate->rows = outcome->used;
    estimate->gaps = outcome->gaps;
    report_into(state, work, estimate);
    return true;
}

int64_t launchid_state_count(const launchid_state *state, launchid_status status)
{
    return state->state.counts.answers[(int64_t)status - RING_BUSY];
}
