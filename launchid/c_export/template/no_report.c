/* ---- what leaves beside the window's outcome: nothing, in this formulation */

#define NO_NUMBER ((double)NAN)

static void report_into(const launchid_state *state, launchid_work *work, launchid_estimate *estimate)
{
    (void)state;
    (void)work;
    estimate->tracked = (launchid_tracked){false, NO_NUMBER, NO_NUMBER, NO_NUMBER, NO_NUMBER, NO_NUMBER};
    estimate->wind = NO_NUMBER;
    estimate->wind_std = NO_NUMBER;
    for (int64_t k = 0; k < LAUNCHID_OFFSETS; k++) {
        estimate->offset[k][0] = NO_NUMBER;
        estimate->offset[k][1] = NO_NUMBER;
    }
    for (int64_t k = 0; k < 3; k++) {
        estimate->actuator[k][0] = NO_NUMBER;
        estimate->actuator[k][1] = NO_NUMBER;
        estimate->actuator_corr[k] = NO_NUMBER;
    }
    for (int64_t k = 0; k < LAUNCHID_MAX_MODES; k++) {
        for (int64_t i = 0; i < 4; i++) {
            estimate->mode[k][i] = NO_NUMBER;
        }
    }
}

int64_t launchid_state_changes(launchid_state *state, launchid_work *work, launchid_change change[])
{
    (void)state;
    (void)work;
    (void)change;
    return 0;
}

launchid_notes launchid_state_notes(const launchid_state *state)
{
    (void)state;
    return (launchid_notes){0, 0, 0, 0};
}
