/* ---- the estimator */

void launchid_state_reset(launchid_state *state)
{
    (void)memset(state, 0, sizeof *state);
$initial    state->state.guard[GUARD_CARRIED] = $seal;
}

launchid_status launchid_state_update(launchid_state *state, launchid_work *work, const launchid_sample *s)
{
    if (state->busy == LAUNCHID_BUSY_MARK) {
        state->state.counts[RING_COUNT_FIRST]++;
        return LAUNCHID_BUSY;
    }
    state->busy = LAUNCHID_BUSY_MARK;
    $block
    int64_t code = $update;
    if (code == RING_RECOVERED) {
        int64_t kept[RING_N_STATUS];
        (void)memcpy(kept, &state->state.counts[RING_COUNT_FIRST], sizeof kept);
        launchid_state_reset(state);
        (void)$update;
        (void)memcpy(&state->state.counts[RING_COUNT_FIRST], kept, sizeof kept);
        code = RING_RECOVERED;
        state->state.counts[(RING_COUNT_FIRST + RING_RECOVERED) - RING_BUSY]++;
    }
    state->busy = 0;
    return (launchid_status)code;
}

bool launchid_state_estimate(launchid_state *state, launchid_work *work, launchid_estimate *estimate)
{
    if (state->state.counts[RING_ESTIMATES] == 0) {
        return false;
    }
    const double *const number = state->state.outcome.number;
    const int64_t *const flag = state->state.outcome.flag;
    estimate->t_start = state->state.clock[RING_T_CLOSED];
    estimate->t_end = estimate->t_start + LAUNCHID_WINDOW;
    estimate->valid = flag[WINDOW_STATUS] == (int64_t)LAUNCHID_OK;
    estimate->status = (launchid_estimate_status)flag[WINDOW_STATUS];
    estimate->a6 = number[WINDOW_O_A6];
    estimate->k1 = number[WINDOW_O_K1];
    estimate->a6_std = number[WINDOW_O_A6_STD];
    estimate->k1_std = number[WINDOW_O_K1_STD];
    estimate->a6_k1_corr = number[WINDOW_O_CORRELATION];
    estimate->a6_dot = number[WINDOW_O_A6_DOT];
    estimate->k1_dot = number[WINDOW_O_K1_DOT];
    estimate->a6_bound = number[WINDOW_O_A6_BOUND];
    estimate->k1_bound = number[WINDOW_O_K1_BOUND];
    estimate->condition = number[WINDOW_O_CONDITION];
    for (int64_t term = 0; term < LAUNCHID_TERMS; term++) {
        for (int64_t equation = 0; equation < 3; equation++) {
            estimate->xi[term][equation] = state->state.outcome.xi[(term * 3) + equation];
            estimate->support[term][equation] = state->state.outcome.support[(term * 3) + equation] != 0;
        }
    }
    estimate->rows = flag[WINDOW_USED];
    estimate->gaps = flag[WINDOW_GAPS_SEEN];
    report_into(state, work, estimate);
    return true;
}

int64_t launchid_state_count(const launchid_state *state, launchid_status status)
{
    return state->state.counts[(RING_COUNT_FIRST + (int64_t)status) - RING_BUSY];
}
