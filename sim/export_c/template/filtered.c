/* ---- the estimator: the predictor takes the samples a block at a time */

static void follow(launchid_estimator *e, int64_t code)
{
    const bool complete = code == LAUNCHID_WINDOW_COMPLETE, restarted = code == LAUNCHID_CLOCK_RESET;
    e->waiting++;
    if (e->waiting < FILTERED_BLOCK && !complete && !restarted) {
        return;
    }
    const int64_t spare = complete ? e->count[RING_CLOSED_BACK] : restarted;
    call_take_samples(e, e->waiting, spare, complete);
    e->waiting = spare;
    if (complete) {
        call_close_filtered(e, e->clock[RING_T_CLOSED] + 0.5 * LAUNCHID_WINDOW);
        e->has_estimate = true;
    } else if (restarted) {
        call_abandon_window(e);
    }
$watch}

/* Between nodes linear, beyond them held: numpy's interp, which returns a time that is no number if there are two nodes
   or more. */
static double interpolated(double t, Vector nodes, Vector values)
{
    if (isnan(t) && nodes.n > 1) {
        return t;
    }
    for (int64_t j = 0; j + 1 < nodes.n; j++) {
        if (t <= nodes.p[j]) {
            return values.p[j];
        }
        if (t < nodes.p[j + 1]) {
            const double slope = (values.p[j + 1] - values.p[j]) / (nodes.p[j + 1] - nodes.p[j]);
            return slope * (t - nodes.p[j]) + values.p[j];
        }
    }
    return values.p[nodes.n - 1];
}

static launchid_tracked tracked(launchid_estimator *e, double t)
{
    const Onboard onboard = call_view_onboard(e).v0;
    const double *total = onboard.bank.total.p;
    if (!known(e)) {
        return (launchid_tracked){false, NAN, NAN, NAN, NAN, NAN};
    }
    const double a6 = interpolated(t, onboard.belief.time, onboard.belief.a6);
    const double k1 = interpolated(t, onboard.belief.time, onboard.belief.k1);
    return (launchid_tracked){
        true, a6 * (1.0 + total[0]), k1 * (1.0 + total[1]), fabs(a6) * sqrt(total[2]), fabs(k1) * sqrt(total[4]),
        copysign(1.0, a6 * k1) * total[3] / sqrt(total[2] * total[4])};
}

int64_t launchid_get_changes(launchid_estimator *e, launchid_change change[])
{
    const Onboard onboard = call_view_onboard(e).v0;
    const Watch watch = onboard.watch;
    const int64_t events = watch.counts.p[CHANGES_EVENTS];
    int64_t found = 0;
    for (int64_t number = max_integer(0, events - CHANGES_MAX_EVENTS); number < events; number++) {
        const double *event = watch.event.p + number % CHANGES_MAX_EVENTS * CHANGES_N_EVENT;
        const double t = event[CHANGES_E_TIME];
        for (int parameter = event[CHANGES_E_KIND] == CHANGES_K1_JUMP; parameter < 2; parameter++) {
            const double *of = event + (parameter ? CHANGES_E_K1_BEFORE : CHANGES_E_A6_BEFORE);
            const double nominal = interpolated(t, onboard.belief.time,
                                                parameter ? onboard.belief.k1 : onboard.belief.a6);
            change[found++] = (launchid_change){
                parameter ? 'k' : 'a', t, event[CHANGES_E_TIME_STD], nominal * (1 + of[0]), nominal * (1 + of[1]),
                nominal * (of[1] - of[0]), fabs(nominal) * sqrt(of[2]), event[CHANGES_E_ALARM],
                event[CHANGES_E_FINAL] != 0.0};
        }
    }
    return found;
}
