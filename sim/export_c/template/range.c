/* ---- the uncertainty level */

static void watch(launchid_estimator *e, bool complete)
{
    call_watch_range(e, e->clock[RING_T_FIRST]);
    if (complete) {
        call_close_range(e, e->clock[RING_T_CLOSED] + LAUNCHID_WINDOW);
    }
}

static launchid_level level_of(const Gauge *gauge, int parameter, bool known)
{
    const bool raised = gauge->flag.p[parameter * UNCERTAINTY_N_FLAGS + UNCERTAINTY_RAISED] != 0;
    launchid_level level = {NAN, NAN, -1, {NAN, NAN, NAN, NAN}, !raised, raised ? gauge->since.p[parameter] : NAN};
    if (known) {
        level.delta = gauge->delta.p[parameter];
        level.delta_std = gauge->delta_std.p[parameter];
        level.band = gauge->band.p[parameter];
        for (int k = 0; k < 4; k++) {
            level.probability[k] = gauge->probability.p[parameter * 4 + k];
        }
    }
    return level;
}

bool launchid_get_level(launchid_estimator *e, launchid_level *a6, launchid_level *k1)
{
    const Gauge gauge = call_view_gauge(e).v0;
    const bool valid = e->has_estimate && known(e);
    *a6 = level_of(&gauge, 0, valid);
    *k1 = level_of(&gauge, 1, valid);
    return valid;
}
