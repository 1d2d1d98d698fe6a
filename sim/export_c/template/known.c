/* ---- what is known */

/* At least one parameter is known better than before the first sample. */
static bool known(launchid_estimator *e)
{
    const double *total = call_view_onboard(e).v0.bank.total.p;
    const double enough = $known * $first_std;
    return min_double(total[2], total[4]) < enough * enough && isfinite(total[0] + total[1]);
}

