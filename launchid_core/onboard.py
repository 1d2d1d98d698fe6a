"""The filtered formulation, block by block: predict, gather, track, watch, relinearise.

A sample's way: gate and ring (`ring.push`) -> once a block's samples wait, or TOGETHER, or a window closed: `predictor`
and `filtered` make rows of them -> of a whole block: `tracker` -> `changes` -> `structure` -> window and noise levels
-> linearisation.  So the cost of a block's algebra is shared by its samples.

Three kinds of memory, apart: `Fixed`, `State`, `Work`.  Parts that a configuration does without (the structure of
many terms, the uncertainty level) are None, and are not compiled.
"""

import numpy as np

from . import ring as rb
from .belief import A6, AT_BETA, AT_THETA, K1, SATURATION
from .changes import (
    JUMP_STD,
    KEPT,
    NEXT,
    ONSETS,
    THRESHOLD,
    follow_onsets,
    open_onset,
    raise_alarm,
    settle_event,
    withdraw_events,
)
from .disturbances import let_offsets_wander, spread_at
from .filtered import (
    GAPS,
    ROWS,
    SAMPLES,
    absorb_block,
    advance_psi,
    begin_block,
    believe_nuisances,
    is_full,
    jump,
    reduce_block,
    relax_levels,
    relinearise,
    start_window,
    take_sample,
    update_levels,
)
from .fit import limit_absent, report_filtered, solve_window
from .guard import (
    CARRIED,
    close_control,
    give_up,
    is_control_whole,
    is_row_whole,
    is_sound,
    refuse,
    seal_carried,
    seal_newest,
)
from .gusts import follow_gust, forget_gust, is_gust, take_gust
from .kernels import inner, merged, once
from .model import TURBULENCE
from .predictor import begins_anew
from .report import report_air, report_changes, report_level, report_tracked
from .states import LAST, N_CHANNELS, N_STATES, RUNNING, WITHDRAWN_CHANGES
from .status import EstimateStatus
from .stores import ENOUGH, ESTIMATE_LEVELS
from .structure import absorb_structure, select_terms
from .stuck import stands_still
from .tracker import (
    COV,
    FIRST_STD,
    MEAN_A6,
    MEAN_K1,
    MEMORY,
    SLOPE_TIME,
    VAR_A6,
    VAR_K1,
    absorb,
    mix,
    restart_bank,
    track,
)
from .uncertainty import close_range, watch_range
from .undeclared import FOUND, follow_undeclared, go_back
from .whiteness import (
    BEYOND_CHANCE,
    FORGOTTEN,
    IN_WINDOW,
    RAISED,
    contradict,
    contradicted_by,
    drop_blocks,
    forget_blocks,
    judge_window,
    likelihood_of_chance,
    queue_block,
    watch_model,
)
from .window import GAPS_SEEN, O_WHITENESS, STATUS, USED, clear_outcome

OK = int(EstimateStatus.OK)
SHORT = int(EstimateStatus.SHORT)
GAP = int(EstimateStatus.GAP)
STUCK = int(EstimateStatus.STUCK)

TOGETHER = 10  # samples at most that wait to be taken together: what an update costs at most, whatever the rate


@inner
def begin_window(fixed, state, t):
    """A window begins after t [s], the last sample's: nothing is known but what is declared."""
    start_window(state.acc)
    believe_nuisances(fixed.belief, state.filter, state.acc, t)


@inner
def remind(belief, fil, bank, work, dt):
    """Tell the quick member again what is declared of the constants that nobody knows.

    A constant offset is tied to the deviations p, x + s (p - p_bar), by the data that do not tell them apart; as the
    member lets p wander over SLOPE_TIME, it would take the offset along, beyond anything declared.
    """
    n, quickest = fil.x.shape[0], bank.mean.shape[0] - 1
    theta, beta = n + belief.term[AT_THETA], n + belief.term[AT_BETA]
    for k in range(N_STATES, n):
        role = belief.role[k - N_STATES]
        if role == TURBULENCE:
            continue
        variance = spread_at(belief, fil, k - N_STATES, fil.time[LAST])
        known = 1.0 - fil.p[k, k] / variance
        if not known > 0.0:
            continue
        w = np.sqrt(known / variance * dt / SLOPE_TIME)
        z = w * (fil.s[k, theta] * fil.p_bar[A6] + fil.s[k, beta] * fil.p_bar[K1] - fil.x[k])
        absorb(bank.mean[quickest], bank.covariance[quickest], work.column, w * fil.s[k, theta], w * fil.s[k, beta], z)
    if n > N_STATES:
        mix(bank)


@once
def accept_gust(belief, state, factor, dt):
    """Where wind has likely begun the filter takes it over; returns whether it has.

    It may have been a loss of k1 after all, which a quiet loop tells no better from a gust: k1 is open as after an
    alarm, so that the tracked estimate follows it and says that it is not known.
    """
    gust = state.gust
    a, k = gust.mean.shape[0] - 2, gust.mean.shape[0] - 1
    if a < 0 or not is_gust(gust, factor, dt):  # below 0: a model without nuisances
        return False
    take_gust(belief, state.filter, state.acc, gust)
    restart_bank(state.bank, gust.mean[a], gust.mean[k], gust.covariance[a, a], gust.covariance[a, k],
                 gust.covariance[k, k] + JUMP_STD * JUMP_STD)
    state.watch.counts[KEPT] = 0
    forget_blocks(state.check)
    forget_gust(gust)
    return True


@inner
def watch_block(fixed, state, work, dt, t_end):
    """Track the block and look for a sudden change; returns True if the filter's state was moved by one, or by a gust
    after calm: nothing before goes with what follows."""
    acc, bank, belief, fil = state.acc, state.bank, work.acc.belief, state.filter
    queue_block(state.check, fil.level, fil.p_bar, bank.total)
    follow_undeclared(fixed.belief, fil, state.undeclared, work.undeclared, work.acc.triangle, bank.weight,
                      contradicted_by(state.check), t_end, dt)
    open_onset(state.watch, bank.total, acc.s_start, acc.start[0])
    block = work.acc.block
    still = track(bank, work.bank, MEMORY, dt, block) - 0.5 * block[2, 2] * block[2, 2]
    remind(fixed.belief, fil, bank, work.bank, dt)
    newest = (state.watch.counts[NEXT] - 1) % ONSETS
    still = follow_gust(fixed.belief, fil, state.gust, work.gust, work.acc.pair, state.watch.before[newest], dt, still)
    factor, slot, kind = follow_onsets(state.watch, work.acc.column, work.acc.pair, fil.s, dt, still)
    if not factor > THRESHOLD or state.check.flag[RAISED] == 1:
        settle_event(state.watch, bank.total)
        return state.check.flag[RAISED] == 0 and accept_gust(fixed.belief, state, factor, dt)
    before = state.watch.before[slot]
    blocks = (state.watch.counts[NEXT] - 1 - slot) % ONSETS + 1
    drop_blocks(state.check, blocks, t_end)
    raise_alarm(state.watch, slot, kind, factor, dt, t_end, belief)
    jump(fixed.belief, fil, state.watch.carried[slot], blocks, before[MEAN_A6], before[MEAN_K1],
         belief[MEAN_A6], belief[MEAN_K1])
    restart_bank(bank, belief[MEAN_A6], belief[MEAN_K1], belief[VAR_A6], belief[COV], belief[VAR_K1])
    go_back(state.undeclared, blocks)
    forget_gust(state.gust)
    return True


@inner
def relinearise_about(belief, fil, bank):
    """About the quick member, so that a drift does not pass for noise; with nuisances about the mixture, or each
    wandering of the quick one along what the data do not tell apart would take them along."""
    if fil.x.shape[0] > N_STATES:
        relinearise(belief, fil, bank.total[MEAN_A6], bank.total[MEAN_K1])
    else:
        quickest = bank.mean.shape[0] - 1
        relinearise(belief, fil, bank.mean[quickest, A6], bank.mean[quickest, K1])


@inner
def close_block(fixed, state, work, learner, learning, period):
    """Use the rows gathered: tracker, change detection, structure, window, noise levels, linearisation."""
    acc, fil, belief = state.acc, state.filter, fixed.belief
    if acc.counts[ROWS] == 0:
        return
    t_end = fil.time[LAST]
    dt = t_end - acc.start[0] + period
    reduce_block(acc, work.acc, belief.term[AT_THETA], belief.term[AT_BETA])
    advance_psi(fil, acc, work.acc)
    moved = watch_block(fixed, state, work, dt, t_end)
    if moved:  # the window begins again, and nothing of this block is noise or structure
        begin_window(fixed, state, t_end)
        acc.score[:] = 0.0
        acc.information[:, :] = 0.0
    else:
        if learner is not None:
            absorb_structure(learner.r, work.acc.triangle, fil.x.shape[0], work.acc.scratch, dt)
        absorb_block(acc, work.acc)
        if state.check.flag[RAISED] == 1:
            relax_levels(belief, fil, acc)
        elif fixed.option[ESTIMATE_LEVELS] == 1:
            update_levels(belief, fil, acc, work.acc)
        relinearise_about(belief, fil, state.bank)
    if watch_model(state.check, fil.level, state.undeclared.flag[FOUND], t_end, dt):
        total = state.bank.total  # what was learned meanwhile is not to be trusted
        restart_bank(state.bank, total[MEAN_A6], total[MEAN_K1], FIRST_STD * FIRST_STD, 0.0, FIRST_STD * FIRST_STD)
    if state.check.flag[BEYOND_CHANCE] == 1:
        fil.note[WITHDRAWN_CHANGES] += withdraw_events(state.watch, t_end - FORGOTTEN)
    acc.counts[ROWS] = 0
    begin_block(belief, fil, acc)


@merged
def take_samples(fixed, state, work, learner, learning, spare, flush):
    """Take the samples that wait in the ring but for the newest `spare`, oldest first.

    A gap or a full block of rows closes the block, and so does the last sample if `flush` (a window closed).
    """
    acc, fil, belief = state.acc, state.filter, fixed.belief
    capacity = state.ring.shape[0]
    max_gap, period = fixed.limits[rb.MAX_GAP], fixed.limits[rb.PERIOD]
    for back in range(state.counts[rb.WAITING], spare, -1):
        row = state.ring[(state.counts[rb.HEAD] - back) % capacity]
        anew = begins_anew(fixed.belief, fil, row[rb.T], max_gap)
        if (anew and fil.time[RUNNING] == 1.0) or is_full(acc):
            close_block(fixed, state, work, learner, learning, period)
        if anew:
            forget_gust(state.gust)
        if acc.counts[ROWS] == 0:
            acc.start[0] = row[rb.T]
        take_sample(belief, fil, work.filter, acc, state.check, row, max_gap)
    if flush or is_full(acc):
        close_block(fixed, state, work, learner, learning, period)
    state.counts[rb.WAITING] = spare


@inner
def learn_terms(belief, state, coefficient, learner, learning):
    """Which of many terms there are, if the configuration learns it."""
    if learner is not None:
        select_terms(learner.r, belief.term[AT_THETA], belief.term[AT_BETA], state.active, coefficient, learning)


@merged
def close_filtered(fixed, state, work, learner, learning):
    """Close the window, its last block being closed: its own estimate into the outcome, and begin the next one."""
    acc, out, belief = state.acc, state.outcome, fixed.belief
    stop = belief.constant
    still = stands_still(state.ring, state.counts, state.repeats, stop[SATURATION], stop[SATURATION + 1],
                         stop[SATURATION + 2])
    learn_terms(belief, state, work.acc.coefficient, learner, learning)
    clear_outcome(out, OK)
    out.flag[USED] = acc.counts[SAMPLES]
    out.flag[GAPS_SEEN] = acc.counts[GAPS]
    if acc.counts[SAMPLES] < fixed.option[ENOUGH]:
        out.flag[STATUS] = GAP if acc.counts[GAPS] > 0 else SHORT
    elif still:
        out.flag[STATUS] = STUCK
        contradict(state.check, state.filter.time[LAST])
    else:
        unexplained = solve_window(belief, acc, work.acc, state.active)
        judge_window(state.check, state.filter.level, unexplained, state.filter.time[LAST])
        t_centre = state.clock[rb.T_CLOSED] + 0.5 * fixed.limits[rb.WINDOW]
        out.flag[STATUS] = report_filtered(belief, state, work.acc, t_centre)
        limit_absent(belief, state, work.acc, t_centre, learner)
        out.number[O_WHITENESS] = likelihood_of_chance(state.check)
    state.check.flag[IN_WINDOW] = state.check.flag[RAISED]
    let_offsets_wander(belief, state.filter, fixed.limits[rb.WINDOW])
    begin_window(fixed, state, state.filter.time[LAST])


@once
def abandon_window(state):
    """The clock was set back: the window is given up and the next one begins."""
    state.acc.counts[ROWS] = 0
    state.filter.time[RUNNING] = 0.0
    start_window(state.acc)


@inner
def follow_range(fixed, state, sigma, gauge, complete):
    """The uncertainty level after a block, if the configuration has one."""
    if gauge is not None:
        if state.check.flag[RAISED] == 1:
            return
        total, watch, clock = state.bank.total, state.watch, state.clock
        watch_range(sigma, gauge, total, state.filter.time[LAST], clock[rb.T_FIRST], watch.counts, watch.event)
        if complete:
            close_range(sigma, gauge, total, clock[rb.T_CLOSED] + fixed.limits[rb.WINDOW])


@inner
def is_block_whole(state, learner, gauge):
    """Whether what waits in the ring, and all that is carried on, is as it was left."""
    if seal_carried(state, learner, gauge) != state.guard[CARRIED]:
        return False
    whole, capacity = True, state.ring.shape[0]
    for back in range(1, state.counts[rb.WAITING] + 1):
        whole = whole and is_row_whole(state.ring, state.seals, (state.counts[rb.HEAD] - back) % capacity)
    return whole


@merged
def follow(fixed, state, work, learner, learning, sigma, gauge, code):
    """A sample was accepted with this status: use what waits, if it is enough; returns False if memory is damaged."""
    counts = state.counts
    complete, reset = code == rb.WINDOW_COMPLETE, code == rb.CLOCK_RESET
    counts[rb.WAITING] += 1
    if counts[rb.WAITING] < min(state.acc.rows.shape[1] // N_CHANNELS, TOGETHER) and not complete and not reset:
        return True
    if not is_block_whole(state, learner, gauge):
        return False
    spare = counts[rb.CLOSED_BACK] if complete else int(reset)
    take_samples(fixed, state, work, learner, learning, spare, complete)
    if complete:
        close_filtered(fixed, state, work, learner, learning)
        counts[rb.ESTIMATES] = 1
    elif reset:
        abandon_window(state)
    follow_range(fixed, state, sigma, gauge, complete)
    state.guard[CARRIED] = seal_carried(state, learner, gauge)
    return is_sound(state.filter, state.bank.total)


@merged
def update_filtered(fixed, state, work, learner, learning, sigma, gauge, t, theta, theta_dot, beta, theta_ddot,
                    beta_cmd, gamma):
    """Take one sample; returns its Status.  RECOVERED: memory is damaged, the caller has to begin anew with it."""
    if not is_control_whole(state):
        return refuse(fixed.limits, state.counts, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma)
    code = rb.push(fixed.limits, state.clock, state.counts, state.ring, t, theta, theta_dot, beta, theta_ddot, beta_cmd,
                   gamma)
    if code >= 0:
        seal_newest(state)
        if not follow(fixed, state, work, learner, learning, sigma, gauge, code):
            return give_up(state.counts, code)
    close_control(state)
    return code


@merged
def report_now(fixed, state, gauge, rep):
    """Everything that leaves beside the outcome, as of now: the closed window's end, or the last sample after it."""
    counts, clock = state.counts, state.clock
    t = clock[rb.T_CLOSED] + fixed.limits[rb.WINDOW]
    if counts[rb.ROWS] > counts[rb.CLOSED_BACK]:
        t = clock[rb.T_LAST]
    contradicted = state.check.flag[RAISED] == 1
    report_tracked(fixed.belief, state.bank.total, contradicted, t, rep)
    report_air(fixed.belief, state.filter, state.bank.total, contradicted, rep)
    report_changes(fixed.belief, state.watch, rep)
    report_level(gauge, rep)
