/* ---- what leaves beside the window's outcome: nothing, in this formulation */

static void report_into(const launchid_state *state, launchid_work *work, launchid_estimate *estimate)
{
    (void)state;
    (void)work;
    estimate->tracked = (launchid_tracked){false, NAN, NAN, NAN, NAN, NAN};
    estimate->wind = estimate->wind_std = NAN;
    for (int k = 0; k < LAUNCHID_OFFSETS; k++) {
        estimate->offset[k][0] = estimate->offset[k][1] = NAN;
    }
}

int64_t launchid_state_changes(launchid_state *state, launchid_work *work, launchid_change change[])
{
    (void)state;
    (void)work;
    (void)change;
    return 0;
}

bool launchid_state_level(launchid_state *state, launchid_work *work, launchid_level *a6, launchid_level *k1)
{
    (void)state;
    (void)work;
    *a6 = *k1 = (launchid_level){NAN, NAN, -1, {NAN, NAN, NAN, NAN}, true, NAN};
    return false;
}

launchid_notes launchid_state_notes(const launchid_state *state)
{
    (void)state;
    return (launchid_notes){0, 0, 0};
}
