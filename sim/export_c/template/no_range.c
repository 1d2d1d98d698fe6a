/* ---- no range, no uncertainty level */

bool launchid_get_level(launchid_estimator *e, launchid_level *a6, launchid_level *k1)
{
    (void)e;
    *a6 = *k1 = (launchid_level){NAN, NAN, -1, {NAN, NAN, NAN, NAN}, true, NAN};
    return false;
}
