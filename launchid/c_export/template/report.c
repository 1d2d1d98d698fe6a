/* ---- what leaves beside the window's outcome */

static void report_into(launchid_state *state, launchid_work *work, launchid_estimate *estimate)
{
    const LaunchidReport *const rep = &work->work.report;
    $block
    $report;
    estimate->tracked = (launchid_tracked){
        rep->flag[REPORT_IS_TRACKED] != 0, rep->tracked[REPORT_TRACKED_A6], rep->tracked[REPORT_TRACKED_K1],
        rep->tracked[REPORT_TRACKED_A6_STD], rep->tracked[REPORT_TRACKED_K1_STD],
        rep->tracked[REPORT_TRACKED_CORRELATION]};
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
}

int64_t launchid_state_changes(launchid_state *state, launchid_work *work, launchid_change change[])
{
    const LaunchidReport *const rep = &work->work.report;
    $block
    $report;
    for (int64_t k = 0; k < rep->flag[REPORT_CHANGES]; k++) {
        const double *const of = &rep->change[k * REPORT_N_CHANGE];
        const int64_t *const kind = &rep->changed[k * REPORT_N_CHANGED];
        change[k] = (launchid_change){
            (kind[REPORT_C_PARAMETER] == 0) ? 'a' : 'k', of[REPORT_C_TIME], of[REPORT_C_TIME_STD], of[REPORT_C_BEFORE],
            of[REPORT_C_AFTER], of[REPORT_C_SIZE], of[REPORT_C_SIZE_STD], of[REPORT_C_ALARM],
            kind[REPORT_C_FINAL] != 0};
    }
    return rep->flag[REPORT_CHANGES];
}

launchid_notes launchid_state_notes(const launchid_state *state)
{
    const int64_t *const note = state->state.filter.note;
    return (launchid_notes){note[STATES_OUTLIERS], note[STATES_RESTARTS], note[STATES_LEVEL_CLAMPS],
                            note[STATES_WITHDRAWN_CHANGES]};
}
