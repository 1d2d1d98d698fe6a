/* ---- what leaves beside the window's outcome */

static void report_into(launchid_state *state, launchid_work *work, launchid_estimate *estimate)
{
    const LaunchidReport *const rep = &work->work.report;
    $block
    $report;
    estimate->tracked = (launchid_tracked){
        rep->is_tracked != 0, rep->tracked.a6, rep->tracked.k1, rep->tracked.a6_std, rep->tracked.k1_std,
        rep->tracked.correlation};
    estimate->wind = rep->air[0];
    estimate->wind_std = rep->air[1];
    for (int64_t k = 0; k < LAUNCHID_OFFSETS; k++) {
        estimate->offset[k][0] = rep->offset[2 * k];
        estimate->offset[k][1] = rep->offset[(2 * k) + 1];
    }
    for (int64_t k = 0; k < 3; k++) {
        estimate->actuator[k][0] = rep->actuator[2 * k];
        estimate->actuator[k][1] = rep->actuator[(2 * k) + 1];
        estimate->actuator_corr[k] = rep->actuator_corr[k];
    }
    for (int64_t k = 0; k < LAUNCHID_MAX_MODES; k++) {
        for (int64_t i = 0; i < 4; i++) {
            estimate->mode[k][i] = (k < LAUNCHID_MODES) ? rep->mode[(4 * k) + i] : (double)NAN;
        }
    }
}

int64_t launchid_state_changes(launchid_state *state, launchid_work *work, launchid_change change[])
{
    const LaunchidReport *const rep = &work->work.report;
    $block
    $report;
    const LaunchidChangeRows *const of = &rep->change;
    for (int64_t k = 0; k < rep->changes; k++) {
        change[k] = (launchid_change){
            (of->parameter[k] == 0) ? 'a' : 'k', of->time[k], of->time_std[k], of->before[k], of->after[k],
            of->size[k], of->size_std[k], of->alarm[k], of->final[k] != 0};
    }
    return rep->changes;
}

launchid_notes launchid_state_notes(const launchid_state *state)
{
    const LaunchidNote *const note = &state->state.filter.note;
    return (launchid_notes){note->outliers, note->restarts, note->level_clamps, note->withdrawn_changes};
}
