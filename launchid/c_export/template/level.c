/* ---- the level: where a6 and k1 stand in their declared range */

static launchid_level level_of(const LaunchidReport *rep, int64_t parameter)
{
    launchid_level level = {rep->delta[parameter], rep->delta_std[parameter], -1, {0.0, 0.0, 0.0, 0.0},
                            rep->raised[parameter] == 0, rep->out_since[parameter]};
    for (int64_t k = 0; k < 4; k++) {
        level.probability[k] = rep->probability[(parameter * 4) + k];
    }
    if (rep->has_level != 0) {
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
    return (state->state.counts.estimates != 0) && (rep->has_level != 0);
}
