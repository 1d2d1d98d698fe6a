/* ---- the level: where a6 and k1 stand in their declared range */

static launchid_level level_of(const LaunchidReport *rep, int64_t parameter)
{
    const double *const of = &rep->level[parameter * REPORT_N_LEVEL];
    launchid_level level = {of[REPORT_DELTA], of[REPORT_DELTA_STD], -1, {0.0, 0.0, 0.0, 0.0},
                            rep->raised[parameter] == 0, of[REPORT_OUT_SINCE]};
    for (int64_t k = 0; k < 4; k++) {
        level.probability[k] = of[REPORT_PROBABILITY + k];
    }
    if (rep->flag[REPORT_HAS_LEVEL] != 0) {
        level.band = rep->band[parameter];
    }
    return level;
}

bool launchid_state_level(launchid_state *state, launchid_work *work, launchid_level *a6, launchid_level *k1)
{
    const LaunchidReport *const rep = &work->work.report;
    $block
    $report;
    *a6 = level_of(rep, 0);
    *k1 = level_of(rep, 1);
    return (state->state.counts[RING_ESTIMATES] != 0) && (rep->flag[REPORT_HAS_LEVEL] != 0);
}
