"""The order of a filtered estimator's work: what is done with a sample, with a block of samples, with a window.

Every sample passes the gate into the ring (`push_sample`).  When a block is full, or a window closes, the block's
samples go through the filter (`gather`), and what they say is used (`close_block`): tracker, undeclared wind, sudden
changes, structure, window, noise levels, check of the model.  A window that closes is solved (`close_window`).

Entries are shallow, for numba compiles all that an entry calls into it; `update_filtered` calls them in turn, in Python
as in C.  What a configuration does without (structure, range) is in entries of its own, which are not compiled then.
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
from .elementary import exp_of
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
from .fit import limit_absent, report_window, solve_window
from .guard import (
    CARRIED,
    close_control,
    fold_rows,
    fold_words,
    give_up,
    is_control_whole,
    is_row_whole,
    refuse,
    seal_newest,
    xor_integer,
)
from .gusts import follow_gust, forget_gust, is_gust, take_gust
from .kernels import inner, kernel
from .model import TURBULENCE
from .plan import ESTIMATE_LEVELS, LEAST_SAMPLES
from .predictor import begins_anew
from .report import report_air, report_changes, report_level, report_no_level, report_tracked
from .states import LAST, N_CHANNELS, N_STATES, RUNNING, WITHDRAWN_CHANGES
from .status import EstimateStatus
from .structure import PRIOR, absorb_structure, select_terms
from .stuck import stands_still
from .tracker import (
    COV,
    FIRST_STD,
    MEAN_A6,
    MEAN_K1,
    MEMBERS,
    MEMORY,
    SLOPE_TIME,
    VAR_A6,
    VAR_K1,
    absorb,
    mix,
    restart_bank,
    track,
)
from .uncertainty import close_range, restart_gauge, watch_range
from .undeclared import FOUND, follow_undeclared, go_back, restart_undeclared
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
DUE = 64       # beside a status: what waits is to be used
ABSURD_LEVEL = 12.0  # of a noise level's logarithm: a factor 160,000 either way is no sensor's


@inner
def begin_window(fixed, state, t):
    """A window begins after t [s], the last sample's: nothing is known but what is declared."""
    start_window(fixed.belief.size, state.acc)
    believe_nuisances(fixed.belief, state.filter, state.acc, t)


@inner
def remind(belief, fil, bank, work, dt):
    """Tell the quick member again what is declared of the constants that nobody knows.

    A constant offset is tied to the deviations p, x + s (p - p_bar), by the data that do not tell them apart; as the
    member lets p wander over SLOPE_TIME, it would take the offset along, beyond anything declared.
    """
    n, quickest = belief.size.states, len(MEMBERS) - 1
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
        absorb(bank.mean[quickest], bank.covariance[quickest], work, w * fil.s[k, theta], w * fil.s[k, beta], z)
    if n > N_STATES:
        mix(bank)


@inner
def accept_gust(belief, state, factor, dt):
    """Where wind has likely begun the filter takes it over; returns whether it has.

    It may have been a loss of k1 after all, which a quiet loop tells no better from a gust: k1 is open as after an
    alarm, so that the tracked estimate follows it and says that it is not known.
    """
    gust = state.gust
    a, k = belief.size.gust - 2, belief.size.gust - 1
    if belief.size.gust == 0 or not is_gust(gust, factor, dt):
        return False
    take_gust(belief, state.filter, state.acc, gust)
    restart_bank(state.bank, gust.mean[a], gust.mean[k], gust.covariance[a, a], gust.covariance[a, k],
                 gust.covariance[k, k] + JUMP_STD * JUMP_STD)
    state.watch.counts[KEPT] = 0
    forget_blocks(state.check)
    forget_gust(gust)
    return True


@inner
def relinearise_about(belief, fil, bank):
    """About the quick member, so that a drift does not pass for noise; with nuisances about the mixture, or each
    wandering of the quick one along what the data do not tell apart would take them along."""
    if belief.size.states > N_STATES:
        relinearise(belief, fil, bank.total[MEAN_A6], bank.total[MEAN_K1])
    else:
        quickest = len(MEMBERS) - 1
        relinearise(belief, fil, bank.mean[quickest, A6], bank.mean[quickest, K1])


@inner
def give_up_window(fixed, state, t):
    """What this block and the window so far say is dropped: the next window begins after t [s]."""
    begin_window(fixed, state, t)
    state.acc.score[:] = 0.0
    state.acc.information[:, :] = 0.0


@inner
def span_of(fixed, state):
    """(the block's time [s], its end [s])"""
    t_end = state.filter.time[LAST]
    return t_end - state.acc.start[0] + fixed.limits[rb.PERIOD], t_end


# ---- a sample


@inner
def take_into_ring(fixed, state, ring, seals, rows, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma):
    """Gate and ring, as `push_sample`."""
    counts = state.counts
    if not is_control_whole(state):
        return refuse(fixed.limits, counts, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma)
    code = rb.push(fixed.limits, state.clock, counts, ring, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma)
    if code >= 0:
        seal_newest(counts, ring, seals)
        counts[rb.WAITING] += 1
        due = counts[rb.WAITING] >= min(rows.shape[1] // N_CHANNELS, TOGETHER)
        if due or code == rb.WINDOW_COMPLETE or code == rb.CLOCK_RESET:
            return code + DUE
    close_control(state)
    return code


@kernel
def push_sample(block, ring, seals, rows, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma):
    """Gate and ring: the sample's Status, and DUE more where what waits is to be used.

    block  (1,) inout  of the estimator (`memory.FILTERED`);  ring (m + 1, 7), seals (m + 1,)  inout
    rows   (c, 3 b)  in  of a block
    """
    return take_into_ring(block[0].fixed, block[0].state, ring, seals, rows, t, theta, theta_dot, beta, theta_ddot,
                          beta_cmd, gamma)


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


# ---- a block


@inner
def seal_carried(state, words, rows):
    """Seal of all that is carried from block to block."""
    carried = fold_words(words)
    return xor_integer(carried, fold_rows(rows, rows.shape[0], state.acc.counts[ROWS]))


@kernel
def is_block_whole(block, ring, seals, rows, words):
    """Whether what waits in the ring, and all that is carried on, is as it was left.

    words  in  of the block what is carried on, seen as int64
    """
    state = block[0].state
    whole, capacity = seal_carried(state, words, rows) == state.guard[CARRIED], ring.shape[0]
    for back in range(1, state.counts[rb.WAITING] + 1):
        whole = whole and is_row_whole(ring, seals, (state.counts[rb.HEAD] - back) % capacity)
    return whole


@kernel
def gather(block, ring, rows, profile, air, code):
    """Take the samples that wait in the ring, oldest first, into the filter, but for those of the next window; True
    if a block is to be closed, and this to be called again.

    A gap or a full block of rows closes the block, and so does the last sample of a window.
    """
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    acc, fil, belief, counts = state.acc, state.filter, fixed.belief, state.counts
    complete = code == rb.WINDOW_COMPLETE
    spare = counts[rb.CLOSED_BACK] if complete else int(code == rb.CLOCK_RESET)
    max_gap = fixed.limits[rb.MAX_GAP]
    for back in range(counts[rb.WAITING], spare, -1):
        row = ring[(counts[rb.HEAD] - back) % ring.shape[0]]
        anew = begins_anew(belief, fil, row[rb.T], max_gap)
        if acc.counts[ROWS] > 0 and ((anew and fil.time[RUNNING] == 1.0) or is_full(acc, rows)):
            counts[rb.WAITING] = back
            return True
        if anew:
            forget_gust(state.gust)
        if acc.counts[ROWS] == 0:
            acc.start[0] = row[rb.T]
        take_sample(belief, profile, air, fil, work.filter, acc, rows, state.check, row, max_gap)
    counts[rb.WAITING] = spare
    return acc.counts[ROWS] > 0 and (complete or is_full(acc, rows))


@kernel
def reduce_rows(block, rows):
    """The rows gathered become the block's triangles."""
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    size, term = fixed.belief.size, fixed.belief.term
    reduce_block(size, state.acc, rows, work.acc, term[AT_THETA], term[AT_BETA])
    advance_psi(size, state.filter, state.acc, work.acc)
    queue_block(state.check, state.filter.level, state.filter.p_bar, state.bank.total)


@kernel
def follow_wind(block, profile):
    """What the block says of wind and misalignment that nobody declared."""
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    dt, t_end = span_of(fixed, state)
    follow_undeclared(fixed.belief, profile, state.filter, state.undeclared, work.undeclared, work.acc.triangle,
                      state.bank.weight, contradicted_by(state.check), t_end, dt)


@kernel
def track_block(block):
    """The tracker takes the block; returns its log density without a sudden change."""
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    belief, bank, fil, watch = fixed.belief, state.bank, state.filter, state.watch
    dt, _ = span_of(fixed, state)
    open_onset(belief.size.states, watch, bank.total, state.acc.s_start, state.acc.start[0])
    triangle = work.acc.block
    still = track(bank, work.bank, MEMORY, dt, triangle) - 0.5 * triangle[2, 2] * triangle[2, 2]
    remind(belief, fil, bank, work.bank, dt)
    newest = (watch.counts[NEXT] - 1) % ONSETS
    return follow_gust(belief, fil, state.gust, work.gust[:], work.acc.pair, watch.before[newest], dt, still)


@kernel
def detect_change(block, still):
    """Look for a sudden change, and for a gust after calm; whether one moved the filter's state: then nothing before
    goes with what follows, the window begins again, and nothing of this block is noise or structure.

    still  log density of the block without a change
    """
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    bank, after, fil, watch, size = state.bank, work.acc.belief, state.filter, state.watch, fixed.belief.size
    dt, t_end = span_of(fixed, state)
    factor, slot, kind = follow_onsets(size.states, watch, work.acc.column[:], work.acc.pair, fil.s, dt, still)
    if not factor > THRESHOLD or state.check.flag[RAISED] == 1:
        settle_event(watch, bank.total)
        moved = state.check.flag[RAISED] == 0 and accept_gust(fixed.belief, state, factor, dt)
        if moved:
            give_up_window(fixed, state, t_end)
        return moved
    before = watch.before[slot]
    blocks = (watch.counts[NEXT] - 1 - slot) % ONSETS + 1
    drop_blocks(state.check, blocks, t_end)
    raise_alarm(watch, slot, kind, factor, dt, t_end, after)
    jump(fixed.belief, fil, watch.carried[slot], blocks, before[MEAN_A6], before[MEAN_K1], after[MEAN_A6],
         after[MEAN_K1])
    restart_bank(bank, after[MEAN_A6], after[MEAN_K1], after[VAR_A6], after[COV], after[VAR_K1])
    if size.undeclared > 0:
        go_back(state.undeclared, blocks)
    forget_gust(state.gust)
    give_up_window(fixed, state, t_end)
    return True


@kernel
def learn_structure(block):
    """The block into the information about which terms there are."""
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    dt, _ = span_of(fixed, state)
    absorb_structure(fixed.belief.size, state.learner.r[:], work.acc.triangle, work.acc.scratch, dt)


@kernel
def use_rows(block):
    """The block into the window's information; noise levels; point of linearisation."""
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    acc, fil, belief = state.acc, state.filter, fixed.belief
    absorb_block(belief.size, acc, work.acc)
    if state.check.flag[RAISED] == 1:
        relax_levels(belief, fil, acc)
    elif fixed.option[ESTIMATE_LEVELS] == 1:
        update_levels(belief, fil, acc, work.acc)
    relinearise_about(belief, fil, state.bank)


@kernel
def end_block(block):
    """Whether the model is true; then the next block begins."""
    fixed, state = block[0].fixed, block[0].state
    acc, fil, bank, check = state.acc, state.filter, state.bank, state.check
    dt, t_end = span_of(fixed, state)
    if watch_model(check, fil.level, state.undeclared.flag[FOUND], t_end, dt):
        total = bank.total  # what was learned meanwhile is not to be trusted
        restart_bank(bank, total[MEAN_A6], total[MEAN_K1], FIRST_STD * FIRST_STD, 0.0, FIRST_STD * FIRST_STD)
    if check.flag[BEYOND_CHANCE] == 1:
        fil.note[WITHDRAWN_CHANGES] += withdraw_events(state.watch, t_end - FORGOTTEN)
    acc.counts[ROWS] = 0
    begin_block(fixed.belief, fil, acc)


def close_block(size, block, rows, profile):
    """Use the rows gathered."""
    reduce_rows(block, rows)
    follow_wind(block, profile)
    still = track_block(block)
    if not detect_change(block, still):
        if size.structured == 1:
            learn_structure(block)
        use_rows(block)
    end_block(block)


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
    """Which of many terms there are."""
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    term = fixed.belief.term
    select_terms(fixed.belief.size.terms, state.learner.r, term[AT_THETA], term[AT_BETA], state.active[:],
                 work.acc.coefficient[:], work.learning)


@inner
def centre_of(fixed, state):
    """The closed window's centre [s]."""
    return state.clock[rb.T_CLOSED] + 0.5 * fixed.limits[rb.WINDOW]


@kernel
def solve_closed(block, profile, stuck):
    """The closed window's own estimate into the outcome; `stuck`: a sensor stood still in it."""
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    acc, out, t = state.acc, state.outcome, state.filter.time[LAST]
    clear_outcome(out, OK)
    out.flag[USED] = acc.counts[SAMPLES]
    out.flag[GAPS_SEEN] = acc.counts[GAPS]
    if acc.counts[SAMPLES] < fixed.option[LEAST_SAMPLES]:
        out.flag[STATUS] = GAP if acc.counts[GAPS] > 0 else SHORT
    elif stuck:
        out.flag[STATUS] = STUCK
        contradict(state.check, t)
    else:
        unexplained = solve_window(fixed.belief, acc, work.acc, state.active[:])
        judge_window(state.check, state.filter.level, unexplained, t)
        out.flag[STATUS] = report_window(fixed.belief, profile, state, work.acc, centre_of(fixed, state))
        out.number[O_WHITENESS] = likelihood_of_chance(state.check)


@kernel
def limit_terms(block, profile):
    """Limits of the terms that are not there."""
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    limit_absent(fixed.belief, profile, state, work.acc, centre_of(fixed, state))


@kernel
def end_window(block):
    """The next window begins."""
    fixed, state = block[0].fixed, block[0].state
    state.check.flag[IN_WINDOW] = state.check.flag[RAISED]
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
    end_window(block)


@kernel
def abandon_window(block):
    """The clock was set back: the window is given up and the next one begins."""
    fixed, state = block[0].fixed, block[0].state
    state.acc.counts[ROWS] = 0
    state.filter.time[RUNNING] = 0.0
    start_window(fixed.belief.size, state.acc)


@kernel
def follow_range(block, sigma, code):
    """The uncertainty level after a block, and after a window."""
    fixed, state = block[0].fixed, block[0].state
    if state.check.flag[RAISED] == 0:
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
    """Memory is damaged: RECOVERED."""
    return give_up(block[0].state.counts, code)


# ---- the order


def follow(size, block, words, ring, seals, rows, profile, air, sigma, code):
    """A sample was accepted with this status, and what waits is to be used; returns the status, or RECOVERED."""
    if not is_block_whole(block, ring, seals, rows, words):
        return drop_sample(block, code)
    for _ in range(2 * TOGETHER):  # a block at most for each sample that waits
        if not gather(block, ring, rows, profile, air, code):
            break
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

    size  in  how much of the memory is in use;  the rest as of the entries, in the order of `memory.APART`
    """
    code = push_sample(block, ring, seals, rows, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma)
    if code >= DUE:
        code = follow(size, block, words, ring, seals, rows, profile, air, sigma, code - DUE)
    return code


@kernel
def restart_filtered(block, rows, words):
    """What is not zero before the first sample."""
    fixed, state = block[0].fixed, block[0].state
    size, acc = fixed.belief.size, state.acc
    clear_outcome(state.outcome, SHORT)
    for k in range(size.levels):
        acc.level_information[k, k] = fixed.belief.prior[k]
    start_window(size, acc)
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
    t = clock[rb.T_CLOSED] + fixed.limits[rb.WINDOW]
    if counts[rb.ROWS] > counts[rb.CLOSED_BACK]:
        t = clock[rb.T_LAST]
    contradicted = state.check.flag[RAISED] == 1
    report_tracked(profile, state.bank.total, contradicted, t, rep)
    report_air(fixed.belief, air, state.filter, state.bank.total, contradicted, rep)
    report_changes(profile, state.watch, rep)
    for k in range(fixed.belief.size.levels):
        rep.noise[k] = exp_of(state.filter.level[k])
    if fixed.belief.size.ranged == 1:
        report_level(state.gauge, rep)
    else:
        report_no_level(rep)
