"""The order of a filtered estimator's work: what is done with a sample, with a block of samples, with a window.

Every sample passes the gate into the ring (`push_sample`).  When a block is full, or a window closes, the block's
samples go through the filter and are used (`block`); a window that closes is solved (`close_window`).

Entries are shallow, for numba compiles all that an entry calls into it; `update_filtered` calls them in turn, in Python
as in C.  What a configuration does without (structure, range) is in entries of its own, which are not compiled then.
"""

import numpy as np

from ..algebra.elementary import exp_of
from ..filter.belief import AT_BETA, AT_THETA, COV, FIRST_STD, MEAN_A6, MEAN_K1, SATURATION, VAR_A6, VAR_K1
from ..filter.disturbances import let_offsets_wander
from ..filter.filtered import BLOCK_GAPS, BLOCK_ROWS, SAMPLES, clear_window
from ..filter.fit import limit_absent, report_window, solve_window
from ..filter.states import LAST, N_CHANNELS, RUNNING
from ..filter.structure import PRIOR, select_terms
from ..filter.unknown_servo import restart_servo
from ..filter.whiteness import IN_WINDOW, WHITENESS_RAISED, contradict, judge_window, likelihood_of_chance
from ..gate import ring as rb
from ..gate.guard import CARRIED, close_control, give_up, take_sample
from ..gate.stuck import stands_still
from ..gate.window import GAP, GAPS_SEEN, O_WHITENESS, OK, SHORT, STATUS, STUCK, USED, clear_outcome
from ..kernels import inner, kernel
from ..regression.plan import LEAST_SAMPLES
from ..watch.report import report_air, report_changes, report_level, report_servo, report_tracked
from ..watch.tracker import MEMBERS, restart_bank
from ..watch.uncertainty import close_range, restart_gauge, watch_range
from ..watch.undeclared import restart_undeclared
from .block import NOTHING, SET_STEP, begin_window, close_block, gather, is_block_whole, seal_carried, set_servo_step

TOGETHER = 10  # samples at most that wait to be taken together: what an update costs at most, whatever the rate
DUE = 64       # beside a status: what waits is to be used
ABSURD_LEVEL = 12.0  # of a noise level's logarithm: a factor 160,000 either way is no sensor's


# ---- a sample


@inner
def take_into_ring(fixed, state, ring, seals, rows, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma):
    """Gate and ring, as `push_sample`."""
    code = take_sample(fixed, state, ring, seals, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma)
    due = state.counts[rb.WAITING] >= min(rows.shape[1] // N_CHANNELS, TOGETHER)
    if 0 <= code < rb.RECOVERED and (due or code == rb.WINDOW_COMPLETE or code == rb.CLOCK_RESET):
        return code + DUE
    return code


@kernel
def push_sample(block, ring, seals, rows, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma):
    """Gate and ring: the sample's Status, and DUE more where what waits is to be used.

    block  (1,) inout  of the estimator (`table.FILTERED`);  ring (m + 1, 7), seals (m + 1,)  inout
    rows   (c, 3 b)  in  of a block
    """
    fixed, state = block[0].fixed, block[0].state
    return take_into_ring(fixed, state, ring, seals, rows, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma)


@kernel
def push_until_due(block, ring, seals, rows, samples, at):
    """`push_sample` for rows of samples (n, 7) from `at` on, until one is due or answers RECOVERED.

    Returns (the row after the last taken, its answer); (n, ACCEPTED) at the end.
    """
    fixed, state = block[0].fixed, block[0].state
    for k in range(at, samples.shape[0]):
        s = samples[k]
        code = take_into_ring(fixed, state, ring, seals, rows, s[0], s[1], s[2], s[3], s[4], s[5], s[6])
        if code >= DUE or code == rb.RECOVERED:
            return k + 1, code
    return samples.shape[0], rb.ACCEPTED


# ---- a window


@kernel
def look_at_sensors(block, ring):
    """Whether a sensor stood still in the closed window."""
    fixed, state = block[0].fixed, block[0].state
    stop = fixed.belief.constant
    return stands_still(ring, state.counts, state.repeats, stop[SATURATION], stop[SATURATION + 1],
                        stop[SATURATION + 2])


@kernel
def choose_terms(block):
    """Choose which of many terms there are."""
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    term = fixed.belief.term
    select_terms(fixed.belief.size.terms, state.learner.r, term[AT_THETA], term[AT_BETA], state.active[:],
                 work.acc.coefficient[:], work.learning)


@kernel
def solve_closed(block, profile, stuck):
    """The closed window's own estimate into the outcome; `stuck`: a sensor stood still in it."""
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    acc, out, t = state.acc, state.outcome, state.filter.time[LAST]
    clear_outcome(out, OK)
    out.flag[USED] = acc.counts[SAMPLES]
    out.flag[GAPS_SEEN] = acc.counts[BLOCK_GAPS]
    if acc.counts[SAMPLES] < fixed.option[LEAST_SAMPLES]:
        out.flag[STATUS] = GAP if acc.counts[BLOCK_GAPS] > 0 else SHORT
    elif stuck:
        out.flag[STATUS] = STUCK
        contradict(state.check, t)
    else:
        unexplained = solve_window(fixed.belief, acc, work.acc, state.active[:])
        judge_window(state.check, state.filter.level, unexplained, t)
        out.flag[STATUS] = report_window(fixed.belief, profile, state, work.acc, rb.centre_of(fixed, state))
        out.number[O_WHITENESS] = likelihood_of_chance(state.check)


@kernel
def limit_terms(block, profile):
    """Limits of the terms that are not there."""
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    limit_absent(fixed.belief, profile, state, work.acc, rb.centre_of(fixed, state))


@kernel
def begin_next_window(block):
    """Begin the next window."""
    fixed, state = block[0].fixed, block[0].state
    state.check.flag[IN_WINDOW] = state.check.flag[WHITENESS_RAISED]
    let_offsets_wander(fixed.belief, state.filter, fixed.limits[rb.WINDOW])
    begin_window(fixed, state, state.filter.time[LAST])
    state.counts[rb.ESTIMATES] = 1


def close_window(size, block, ring, profile):
    """Estimate from the window that closed, its last block being closed."""
    stuck = look_at_sensors(block, ring)
    if size.structured == 1:
        choose_terms(block)
    solve_closed(block, profile, stuck)
    if size.structured == 1:
        limit_terms(block, profile)
    begin_next_window(block)


@kernel
def abandon_window(block):
    """The clock was set back: the window is given up and the next one begins."""
    fixed, state = block[0].fixed, block[0].state
    state.acc.counts[BLOCK_ROWS] = 0
    state.filter.time[RUNNING] = 0.0
    clear_window(fixed.belief.size, state.acc)


@kernel
def follow_range(block, sigma, code):
    """The uncertainty level after a block, and after a window."""
    fixed, state = block[0].fixed, block[0].state
    if state.check.flag[WHITENESS_RAISED] == 0:
        total, watch, clock = state.bank.total, state.watch, state.clock
        watch_range(sigma, state.gauge, total, state.filter.time[LAST], clock[rb.T_FIRST], watch.counts, watch.event)
        if code == rb.WINDOW_COMPLETE:
            close_range(sigma, state.gauge, total, clock[rb.T_CLOSED] + fixed.limits[rb.WINDOW])


@inner
def is_sound(size, fil, total):
    """Whether what is carried over the whole flight can be: all finite, no variance below 0, no absurd noise level.

    total (N_BELIEF,) in  the tracked belief
    """
    sound = np.isfinite(total[MEAN_A6] + total[MEAN_K1] + total[COV] + total[VAR_A6] + total[VAR_K1])
    sound = sound and total[VAR_A6] >= 0.0 and total[VAR_K1] >= 0.0
    for i in range(size.states):
        sound = sound and np.isfinite(fil.x[i])
        for j in range(size.states):
            sound = sound and np.isfinite(fil.p[i, j])
    for j in range(size.servo):
        sound = sound and np.isfinite(fil.servo.mean[j])
    for k in range(size.levels):
        sound = sound and abs(fil.level[k]) <= ABSURD_LEVEL
    return sound


@kernel
def seal_block(block, rows, words, code):
    """All stays as it is until the next block; the status, or RECOVERED where memory is damaged."""
    fixed, state = block[0].fixed, block[0].state
    state.guard[CARRIED] = seal_carried(state, words, rows)
    if not is_sound(fixed.belief.size, state.filter, state.bank.total):
        return give_up(state.counts, code)
    close_control(state)
    return code


@kernel
def drop_sample(block, code):
    """Return RECOVERED: memory is damaged before the block is used."""
    return give_up(block[0].state.counts, code)


# ---- the order


def process_samples(size, block, words, ring, seals, rows, profile, air, sigma, code):
    """Filter the samples that wait, close blocks and windows; return the Status, RECOVERED where memory is damaged."""
    if not is_block_whole(block, ring, seals, rows, words):
        return drop_sample(block, code)
    for _ in range(3 * TOGETHER):  # a block and a step at most for each sample that waits
        wanted = gather(block, ring, rows, profile, air, code)
        if wanted == NOTHING:
            break
        if size.servo > 0 and wanted == SET_STEP:
            set_servo_step(block)
        else:
            close_block(size, block, rows, profile)
    if code == rb.WINDOW_COMPLETE:
        close_window(size, block, ring, profile)
    elif code == rb.CLOCK_RESET:
        abandon_window(block)
    if size.ranged == 1:
        follow_range(block, sigma, code)
    return seal_block(block, rows, words, code)


def update_filtered(size, block, words, ring, seals, rows, profile, air, sigma, t, theta, theta_dot, beta, theta_ddot,
                    beta_cmd, gamma):
    """Take one sample; returns its Status.  RECOVERED: memory is damaged, the caller has to begin anew with it.

    size  in  how much of the memory is in use;  the rest as of the entries, in the order of `table.APART`
    """
    code = push_sample(block, ring, seals, rows, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma)
    if code >= DUE:
        code = process_samples(size, block, words, ring, seals, rows, profile, air, sigma, code - DUE)
    return code


@kernel
def restart_filtered(block, rows, words):
    """Set what is not zero before the first sample."""
    fixed, state = block[0].fixed, block[0].state
    size, acc = fixed.belief.size, state.acc
    clear_outcome(state.outcome, SHORT)
    for k in range(size.levels):
        acc.level_information[k, k] = fixed.belief.prior[k]
    clear_window(size, acc)
    restart_servo(fixed.belief, state.filter)
    for k in range(len(MEMBERS)):
        state.bank.weight[k] = 1.0 / len(MEMBERS)
    restart_bank(state.bank, 0.0, 0.0, FIRST_STD * FIRST_STD, 0.0, FIRST_STD * FIRST_STD)
    if size.undeclared > 0:
        restart_undeclared(state.undeclared)
    for k in range(size.terms):
        state.active[k] = 1
        if size.structured == 1:
            state.learner.r[k, k] = PRIOR
    if size.ranged == 1:
        restart_gauge(state.gauge)
    state.guard[CARRIED] = seal_carried(state, words, rows)


@kernel
def report_now(block, profile, air):
    """Everything that leaves beside the outcome, as of now: the closed window's end, or the last sample after it."""
    fixed, state, rep = block[0].fixed, block[0].state, block[0].work.report
    counts, clock = state.counts, state.clock
    is_later = counts[rb.ROWS] > counts[rb.CLOSED_BACK]
    t = clock[rb.T_LAST] if is_later else clock[rb.T_CLOSED] + fixed.limits[rb.WINDOW]
    contradicted = state.check.flag[WHITENESS_RAISED] == 1
    report_tracked(profile, state.bank.total, contradicted, t, rep)
    report_air(fixed.belief, air, state.filter, state.bank.total, contradicted, rep)
    report_servo(fixed.belief, state.filter, contradicted, rep)
    report_changes(profile, state.watch, rep)
    for k in range(fixed.belief.size.levels):
        rep.noise[k] = exp_of(state.filter.level[k])
    report_level(fixed.belief.size, state.gauge, rep)
