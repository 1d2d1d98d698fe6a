"""The entries of a block: its samples go through the filter, and what they say is used.

Gathered (`gather`), reduced to triangles (`reduce_rows`), asked for wind that nobody declared
(`estimate_undeclared_wind`), tracked (`track_block`), asked for a sudden change (`detect_change`), then added to the
structure, to the window's information and to the noise levels (`learn_structure`, `use_rows`); at last the model is
judged and the next block begins (`end_block`).  `close_block` is their order, `onboard` the order of all.
"""

import numpy as np

from ..algebra.linsolve import carry_columns
from ..filter import belief as bl
from ..filter import filtered as fl
from ..filter import unknown_servo as us
from ..filter import whiteness as wh
from ..filter.belief import A6, AT_BETA, AT_THETA, CHANGE_BLOCKS, COV, K1, MEAN_A6, MEAN_K1, VAR_A6, VAR_K1
from ..filter.disturbances import spread_at
from ..filter.predictor import begins_anew
from ..filter.states import LAST, N_STATES, RUNNING, WITHDRAWN_CHANGES
from ..filter.structure import absorb_structure
from ..filter.whiteness import contradicted_by, drop_blocks, forget_blocks, queue_block, watch_model
from ..gate import ring as rb
from ..gate.guard import CARRIED, fold_rows, fold_words, is_row_whole, mixed, seal_integer
from ..kernels import inner, kernel
from ..model import TURBULENCE
from ..regression.plan import ESTIMATE_LEVELS
from ..watch import changes as ch
from ..watch.changes import follow_onsets, open_onset, raise_alarm, settle_event, withdraw_events
from ..watch.gusts import follow_gust, forget_gust, is_gust, take_gust
from ..watch.tracker import MEMBERS, SLOPE_TIME, TRACKER_MEMORY, absorb, mix, restart_bank, track
from ..watch.undeclared import AGE, FOUND, NEWER, follow_undeclared, go_back

NOTHING, CLOSE, SET_STEP = range(3)  # what is to be done after `gather`


@inner
def begin_window(fixed, state, t):
    """A window begins after t [s], the last sample's: nothing is known but what is declared."""
    fl.clear_window(fixed.belief.size, state.acc)
    fl.believe_nuisances(fixed.belief, state.filter, state.acc, t)


@inner
def restate_declared(belief, fil, bank, work, dt):
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
    """Let the filter take over wind that has likely begun; returns whether it has.

    It may have been a loss of k1 after all, which a quiet loop tells no better from a gust: k1 is open as after an
    alarm, so that the tracked estimate follows it and says that it is not known.
    """
    gust = state.gust
    a, k = belief.size.gust - 2, belief.size.gust - 1
    if belief.size.gust == 0 or not is_gust(gust, factor, dt):
        return False
    take_gust(belief, state.filter, state.acc, gust)
    restart_bank(state.bank, gust.mean[a], gust.mean[k], gust.covariance[a, a], gust.covariance[a, k],
                 gust.covariance[k, k] + ch.JUMP_STD * ch.JUMP_STD)
    state.watch.counts[ch.KEPT_EVENTS] = 0
    forget_blocks(state.check)
    forget_gust(gust)
    return True


@inner
def relinearise_about(belief, fil, bank):
    """Linearise about the quick member, so that a drift does not pass for noise; with nuisances about the mixture, or
    each wandering of the quick one along what the data do not tell apart would take them along."""
    if belief.size.states > N_STATES:
        fl.relinearise(belief, fil, bank.total[MEAN_A6], bank.total[MEAN_K1])
    else:
        quickest = len(MEMBERS) - 1
        fl.relinearise(belief, fil, bank.mean[quickest, A6], bank.mean[quickest, K1])


@inner
def restart_window(fixed, state, t):
    """Drop this block and the window so far; begin one after t [s]."""
    begin_window(fixed, state, t)
    state.acc.score[:] = 0.0
    state.acc.information[:, :] = 0.0


@inner
def span_of(fixed, state):
    """The block's time [s] and its end [s]."""
    t_end = state.filter.time[LAST]
    return t_end - state.acc.start[0] + fixed.limits[rb.PERIOD], t_end


@inner
def seal_carried(state, words, rows):
    """Seal of all that is carried from block to block."""
    carried, count = mixed(fold_words(words)), state.acc.counts[fl.BLOCK_ROWS]
    count = min(max(count, 0), rows.shape[1])  # it may be damaged
    return seal_integer(carried, fold_rows(rows, rows.shape[0], count), 0)


@inner
def is_within(state, ring, rows):
    """Whether every place and count that is carried on lies within its array."""
    seen, flag, other = state.watch.counts, state.check.flag, state.undeclared.flag
    within = 0 <= state.acc.counts[fl.BLOCK_ROWS] <= rows.shape[1] and state.counts[rb.WAITING] <= ring.shape[0]
    within = within and 0 <= seen[ch.NEXT] < CHANGE_BLOCKS and seen[ch.EVENTS] >= 0
    within = within and 0 <= seen[ch.KEPT_EVENTS] <= CHANGE_BLOCKS
    within = within and 0 <= flag[wh.OLDEST] < CHANGE_BLOCKS and 0 <= flag[wh.BLOCKS_WAITING] <= CHANGE_BLOCKS
    return within and 0 <= other[NEWER] <= 1 and other[AGE] >= 0


@kernel
def is_block_whole(block, ring, seals, rows, words):
    """Whether what waits in the ring, and all that is carried on, is as it was left.

    words  in  of the block what is carried on, seen as int64
    """
    state = block[0].state
    capacity = ring.shape[0]
    whole = is_within(state, ring, rows) and seal_carried(state, words, rows) == state.guard[CARRIED]
    if not whole:
        return False
    for back in range(1, state.counts[rb.WAITING] + 1):
        whole = whole and is_row_whole(ring, seals, (state.counts[rb.HEAD] - back) % capacity)
    return whole


@kernel
def gather(block, ring, rows, profile, air, code):
    """Take the samples that wait in the ring, oldest first, into the filter, but for those of the next window; what is
    to be done before this is called again: NOTHING, and it need not be, CLOSE the block, or SET_STEP.

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
        if acc.counts[fl.BLOCK_ROWS] > 0 and ((anew and fil.time[RUNNING] == 1.0) or fl.is_full(acc, rows)):
            counts[rb.WAITING] = back
            return CLOSE
        if belief.size.servo > 0:
            is_set = anew or not us.note_step(fil, row[rb.T] - fil.time[LAST])
            if not is_set:
                counts[rb.WAITING] = back
                return SET_STEP
        if anew:
            forget_gust(state.gust)
        if acc.counts[fl.BLOCK_ROWS] == 0:
            acc.start[0] = row[rb.T]
        fl.filter_sample(belief, profile, air, fil, work.filter, acc, rows, state.check, row, max_gap)
    counts[rb.WAITING] = spare
    return CLOSE if acc.counts[fl.BLOCK_ROWS] > 0 and (complete or fl.is_full(acc, rows)) else NOTHING


@kernel
def set_servo_step(block):
    """Constants of the next step with a servo that is not known."""
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    us.set_unknown_step(fixed.belief, state.filter, work.filter)


@kernel
def reduce_rows(block, rows):
    """The rows gathered become the block's triangles."""
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    size, term = fixed.belief.size, fixed.belief.term
    fl.reduce_block(size, state.acc, rows, work.acc, term[AT_THETA], term[AT_BETA])
    carry_columns(state.filter.s[:], size.states, state.acc.psi[:], size.states, work.acc.column[:])
    queue_block(state.check, state.filter.level, state.filter.p_bar, state.bank.total)


@kernel
def widen_check_by_servo(block):
    """Take what is not known of the servo out of the check, which it does not contradict."""
    fixed, state = block[0].fixed, block[0].state
    us.widen_check(fixed.belief, state.filter, state.check)


@kernel
def update_servo(block):
    """Add what the block says of the servo to what is known of it; what is not known of it widens what the block says
    of a6 and k1, and is no noise.  While the model is contradicted what was learned of it fades as the levels do."""
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    belief, fil, acc, servo = fixed.belief, state.filter, state.acc, state.filter.servo
    us.widen_pair(belief, fil, work.acc)
    fl.reduce_pair(belief.size, work.acc)
    if us.share_unknown(belief, fil, work.acc, acc.counts[fl.BLOCK_ROWS]) > us.UNSETTLED:
        acc.score[:] = 0.0
        acc.information[:, :] = 0.0
    if state.check.flag[wh.WHITENESS_RAISED] == 1:
        us.fade_servo(belief.size, servo, work.acc, fl.left_after(belief.constant[bl.BLOCK_SHARE], fl.LEVEL_RELAXES))
    us.learn_servo(belief, fil, work.acc)
    us.solve_servo(belief.size, servo)


@kernel
def relinearise_servo(block):
    """The filter's servo is the one estimated."""
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    us.move_servo(fixed.belief, state.filter, work.acc)


@kernel
def estimate_undeclared_wind(block, profile):
    """Take what the block says of wind and misalignment that nobody declared."""
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
    still = track(bank, work.bank, TRACKER_MEMORY, dt, triangle) - 0.5 * triangle[2, 2] * triangle[2, 2]
    restate_declared(belief, fil, bank, work.bank, dt)
    newest = (watch.counts[ch.NEXT] - 1) % CHANGE_BLOCKS
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
    factor, slot, kind = follow_onsets(size.states, watch, work.bank, work.acc.column[:], work.acc.pair, fil.s, dt,
                                       still)
    if not factor > ch.THRESHOLD or state.check.flag[wh.WHITENESS_RAISED] == 1:
        settle_event(watch, bank.total)
        moved = state.check.flag[wh.WHITENESS_RAISED] == 0 and accept_gust(fixed.belief, state, factor, dt)
        if moved:
            restart_window(fixed, state, t_end)
        return moved
    before = watch.before[slot]
    blocks = (watch.counts[ch.NEXT] - 1 - slot) % CHANGE_BLOCKS + 1
    drop_blocks(state.check, blocks, t_end)
    raise_alarm(watch, slot, kind, factor, dt, t_end, after)
    fl.jump(fixed.belief, fil, watch.carried[slot], blocks, before[MEAN_A6], before[MEAN_K1], after[MEAN_A6],
         after[MEAN_K1])
    restart_bank(bank, after[MEAN_A6], after[MEAN_K1], after[VAR_A6], after[COV], after[VAR_K1])
    if size.undeclared > 0:
        go_back(state.undeclared, blocks)
    forget_gust(state.gust)
    restart_window(fixed, state, t_end)
    return True


@kernel
def learn_structure(block):
    """The block into the information about which terms there are."""
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    dt, _ = span_of(fixed, state)
    absorb_structure(fixed.belief.size, state.learner.r[:], work.acc, dt)


@kernel
def use_rows(block):
    """The block into the window's information; noise levels; point of linearisation."""
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    acc, fil, belief = state.acc, state.filter, fixed.belief
    fl.absorb_block(belief.size, acc, work.acc, fil.servo.about[:])
    if state.check.flag[wh.WHITENESS_RAISED] == 1:
        fl.relax_levels(belief, fil, acc)
    elif fixed.option[ESTIMATE_LEVELS] == 1:
        fl.update_levels(belief, fil, acc, work.acc)
    relinearise_about(belief, fil, state.bank)


@kernel
def end_block(block):
    """Judge whether the model is true; then begin the next block."""
    fixed, state = block[0].fixed, block[0].state
    acc, fil, bank, check = state.acc, state.filter, state.bank, state.check
    dt, t_end = span_of(fixed, state)
    if watch_model(check, fil.level, state.undeclared.flag[FOUND], t_end, dt):
        total = bank.total  # what was learned meanwhile is not to be trusted
        first = bl.FIRST_STD * bl.FIRST_STD
        restart_bank(bank, total[MEAN_A6], total[MEAN_K1], first, 0.0, first)
    if check.flag[wh.BEYOND_CHANCE] == 1:
        fil.note[WITHDRAWN_CHANGES] += withdraw_events(state.watch, t_end - wh.LONGEST_MEMORY)
    acc.counts[fl.BLOCK_ROWS] = 0
    fl.begin_block(fixed.belief, fil, acc)


def close_block(size, block, rows, profile):
    """Use the rows gathered."""
    if size.servo > 0:
        widen_check_by_servo(block)
    reduce_rows(block, rows)
    if size.servo > 0:
        update_servo(block)
    estimate_undeclared_wind(block, profile)
    still = track_block(block)
    if not detect_change(block, still):
        if size.structured == 1:
            learn_structure(block)
        use_rows(block)
    if size.servo > 0:
        relinearise_servo(block)
    end_block(block)
