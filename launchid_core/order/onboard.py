"""The order of a filtered estimator's work: what is done with a sample, with a block of samples, with a window.

Every sample passes the gate into the ring (`push_sample`).  When a block is full, or a window closes, the block's
samples go through the filter and are used (`close_block`); a window that closes is solved (`close_window`).

Entries are shallow, for numba compiles all that an entry calls into it; `update_filtered` calls them in turn, in Python
as in C.  What a configuration does without (structure, range) is in entries of its own, which are not compiled then.
"""

from ..algebra.elementary import exp_of
from ..filter import filtered as fl
from ..filter import modes as md
from ..filter import servo as sv
from ..filter import states as sx
from ..filter import whiteness as wh
from ..filter.kalman import begins_anew
from ..filter.structure import PRIOR, choose_terms, learn_structure
from ..gate import guard as gd
from ..gate import ring as rb
from ..gate import window as wn
from ..gate.guard import fold_words, mixed, seal_integer
from ..gate.stuck import stands_still
from ..kernels import inner, kernel
from ..watch import changes as ch
from ..watch import gusts as gu
from ..watch import report as rp
from ..watch import tracker as tr
from ..watch import undeclared as un
from ..watch.uncertainty import close_range, restart_gauge, watch_range

TOGETHER = 10  # samples at most that wait to be taken together: what an update costs at most, whatever the rate
NOTHING, CLOSE, CLOSE_LAST, SET_STEP = range(4)  # what is to be done after `gather`


@inner
def seal_carried(state, words, rows):
    """Seal of all that is carried from block to block."""
    carried, count = mixed(fold_words(words)), state.acc.counts.rows
    count = min(max(count, 0), rows.shape[1])  # it may be damaged
    seal = 0
    for j in range(rows.shape[0]):
        seal = seal_integer(mixed(seal), gd.fold(rows[j], count), 0)
    return seal_integer(carried, seal, 0)


@kernel
def check_block(block, ring, seals, rows, words, code):
    """The status `code`, or RECOVERED where what waits in the ring, or is carried on, is not as it was left."""
    state, capacity = block[0].state, ring.shape[0]
    counts, seen, check, other = state.counts, state.watch.counts, state.check, state.undeclared
    # every place and count that is carried on lies within its array
    whole = 0 <= state.acc.counts.rows <= rows.shape[1] and counts.waiting <= capacity
    whole = whole and 0 <= seen.next < sx.CHANGE_BLOCKS and seen.events >= 0
    whole = whole and 0 <= seen.kept <= sx.CHANGE_BLOCKS
    whole = whole and 0 <= check.oldest < sx.CHANGE_BLOCKS and 0 <= check.waiting <= sx.CHANGE_BLOCKS
    whole = whole and 0 <= other.newer <= 1 and other.age >= 0
    whole = whole and seal_carried(state, words, rows) == state.guard.carried
    if whole:
        for back in range(1, counts.waiting + 1):
            whole = whole and gd.is_row_whole(ring, seals, (counts.head - back) % capacity)
    return code if whole else gd.give_up(counts, code)


@kernel
def gather(block, ring, rows, profile, air, modes, known, shown, code):
    """Take the samples that wait in the ring, oldest first, into the filter, but for those of the next window; what is
    to be done before this is called again: NOTHING or CLOSE_LAST, and it need not be, CLOSE the block, or SET_STEP.

    A gap or a full block of rows closes the block, and so does the last sample of a window.
    """
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    acc, fil, belief, counts = state.acc, state.filter, fixed.belief, state.counts
    complete = code == rb.WINDOW_COMPLETE
    spare = counts.closed_back if complete else int(code == rb.CLOCK_RESET)
    max_gap = fixed.limits.max_gap
    for back in range(counts.waiting, spare, -1):
        row = ring[(counts.head - back) % ring.shape[0]]
        anew = begins_anew(belief, fil, row[rb.T], max_gap)
        full = acc.counts.rows > rows.shape[1] - sx.N_CHANNELS  # no room for another sample's
        if acc.counts.rows > 0 and (full or (anew and fil.time.running == 1.0)):
            counts.waiting = back
            return CLOSE
        if belief.size.servo > 0:
            h = row[rb.T] - fil.time.last
            fil.servo.next_step = h
            if not anew and abs(h - fil.step.h) > sv.SAME_STEP * h:
                counts.waiting = back
                return SET_STEP
        elif belief.size.modes > 0:
            fil.modes.next_step = row[rb.T] - fil.time.last
            if not anew and abs(fil.modes.next_step - fil.step.h) > sv.SAME_STEP * fil.modes.next_step:
                counts.waiting = back
                return SET_STEP
        if anew:
            gu.forget_gust(state.gust)
        if acc.counts.rows == 0:
            acc.start = row[rb.T]
        fl.filter_sample(belief, profile, air, modes, known, shown, fil, work.filter, acc, rows, state.check, row,
                         max_gap)
    counts.waiting = spare
    full = acc.counts.rows > rows.shape[1] - sx.N_CHANNELS
    return CLOSE_LAST if full or (complete and acc.counts.rows > 0) else NOTHING


@kernel
def track_block(block):
    """The tracker takes the block; returns its log density without a sudden change."""
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    belief, bank, fil, watch = fixed.belief, state.bank, state.filter, state.watch
    dt, _ = fl.span_of(fixed, state)
    before, total = work.acc.before, bank.total
    before.mean_a6, before.mean_k1 = total.mean_a6, total.mean_k1
    before.var_a6, before.cov, before.var_k1 = total.var_a6, total.cov, total.var_k1
    ch.open_onset(belief.size.states, watch, bank.total, state.acc.s_start, state.acc.start)
    triangle = work.acc.block
    still = tr.track(belief.slopes[:], bank, work.bank, tr.TRACKER_MEMORY, dt, triangle)
    still -= 0.5 * triangle[2, 2] * triangle[2, 2]
    tr.restate_declared(belief, fil, bank, work.bank, dt)
    return gu.follow_gust(belief, fil, state.gust, work.gust[:], work.acc.pair, before, dt, still)


@kernel
def detect_change(block, still):
    """Look for a sudden change, and for a gust after calm; whether one moved the filter's state: then nothing before
    goes with what follows, the window begins again, and nothing of this block is noise or structure.
    still  log density of the block without a change"""
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    bank, after, fil, watch, size = state.bank, work.acc.belief, state.filter, state.watch, fixed.belief.size
    dt, t_end = fl.span_of(fixed, state)
    factor, slot, kind = ch.follow_onsets(size.states, watch, work.bank, work.acc.column[:], work.acc.pair, fil.s, dt,
                                       still)
    if not factor > ch.THRESHOLD or state.check.raised == 1:
        ch.settle_event(watch, bank.total)
        moved = state.check.raised == 0 and gu.accept_gust(fixed.belief, state, factor, dt)
        if moved:
            fl.restart_window(fixed, state, t_end)
        return moved
    before = watch.before
    blocks = (watch.counts.next - 1 - slot) % sx.CHANGE_BLOCKS + 1
    wh.drop_blocks(state.check, blocks, t_end)
    ch.raise_alarm(watch, slot, kind, factor, dt, t_end, after)
    fl.jump(fixed.belief, fil, watch.carried[slot], blocks, before.mean_a6[slot], before.mean_k1[slot], after.mean_a6,
         after.mean_k1)
    tr.restart_bank(fixed.belief.slopes[:], bank, after.mean_a6, after.mean_k1, after.var_a6, after.cov,
                    after.var_k1)
    if size.undeclared > 0:
        un.go_back(state.undeclared, blocks)
    gu.forget_gust(state.gust)
    fl.restart_window(fixed, state, t_end)
    return True


@kernel
def use_rows(block):
    """The block into the window's information; noise levels; point of linearisation.

    It is the quick member's, so that a drift does not pass for noise; with nuisances the mixture's, or each wandering
    of the quick one along what the data do not tell apart would take them along.
    """
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    acc, fil, belief, bank, quickest = state.acc, state.filter, fixed.belief, state.bank, len(tr.MEMBERS) - 1
    fl.absorb_block(belief.size, acc, work.acc, fil.servo.about[:], fil.modes.about[:])
    if state.check.raised == 1:
        fl.relax_levels(belief, fil, acc)
    elif fixed.option.estimate_levels == 1:
        fl.update_levels(belief, fil, acc, work.acc)
    if belief.size.nuisances > 0:
        fl.relinearise(belief, fil, bank.total.mean_a6, bank.total.mean_k1)
    else:
        fl.relinearise(belief, fil, bank.mean[quickest, sx.A6], bank.mean[quickest, sx.K1])


@kernel
def end_block(block):
    """Judge whether the model is true; then begin the next block."""
    fixed, state = block[0].fixed, block[0].state
    acc, fil, bank, check = state.acc, state.filter, state.bank, state.check
    dt, t_end = fl.span_of(fixed, state)
    if check.waiting >= sx.CHANGE_BLOCKS:  # they have waited long enough
        wh.take_block(check, dt)
    if wh.judge_model(check, fil.level, state.undeclared.found, t_end):
        total = bank.total  # what was learned meanwhile is not to be trusted
        first = sx.FIRST_STD * sx.FIRST_STD
        tr.restart_bank(fixed.belief.slopes[:], bank, total.mean_a6, total.mean_k1, first, 0.0, first)
    if check.beyond_chance == 1:
        fil.note.withdrawn_changes += ch.withdraw_since(state.watch, t_end - wh.LONGEST_MEMORY)
    acc.counts.rows = 0
    fl.begin_block(fixed.belief, fil, acc)


def close_block(size, block, rows, profile):
    """Use the rows gathered."""
    if size.servo > 0:
        sv.widen_check(block)
    if size.numbers > 0:
        md.widen_mode_check(block)
    fl.reduce_rows(block, rows)
    if size.servo > 0:
        fl.update_servo(block)
    if size.numbers > 0:
        fl.update_numbers(block)
    un.follow_undeclared(block, profile)
    still = track_block(block)
    if not detect_change(block, still):
        if size.structured == 1:
            learn_structure(block)
        use_rows(block)
    elif size.numbers > 0:
        md.open_rigid(block)
    if size.servo > 0:
        sv.relinearise_servo(block)
    if size.modes > 0:
        md.relinearise_modes(block)
    end_block(block)


# ---- a sample


@inner
def take_into_ring(fixed, state, ring, seals, rows, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma):
    """Gate and ring, as `push_sample`."""
    code = gd.take_sample(fixed, state, ring, seals, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma)
    due = state.counts.waiting >= min(rows.shape[1] // sx.N_CHANNELS, TOGETHER)
    if 0 <= code < rb.RECOVERED and (due or code == rb.WINDOW_COMPLETE or code == rb.CLOCK_RESET):
        return code + rb.DUE
    return code


@kernel
def push_sample(block, ring, seals, rows, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma):
    """Gate and ring: the sample's Status, and DUE more where what waits is to be used."""
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
        if code >= rb.DUE or code == rb.RECOVERED:
            return k + 1, code
    return samples.shape[0], rb.ACCEPTED


# ---- a window


@kernel
def solve_closed(block, ring, profile):
    """The closed window's own estimate into the outcome."""
    fixed, state, work = block[0].fixed, block[0].state, block[0].work
    acc, out, t = state.acc, state.outcome, state.filter.time.last
    stuck = stands_still(ring, state.counts, state.repeats, fixed.belief.constant.saturation)
    wn.clear_outcome(out, wn.OK)
    out.used = acc.counts.samples
    out.gaps = acc.counts.gaps
    if acc.counts.samples < fixed.option.least_samples:
        out.status = wn.GAP if acc.counts.gaps > 0 else wn.SHORT
    elif stuck:
        out.status = wn.STUCK
        wh.contradict(state.check, t)
    else:
        age = rb.centre_of(fixed, state) - state.filter.time.first
        unexplained = fl.solve_window(fixed.belief, acc, work.acc, state.active[:], age)
        wh.judge_window(state.check, state.filter.level, unexplained, t)
        out.status = fl.report_window(fixed.belief, profile, state, work.acc, rb.centre_of(fixed, state))
        out.whiteness = wh.likelihood_of_chance(state.check)


@kernel
def begin_next_window(block):
    """Begin the next window after the last sample: nothing is known but what is declared."""
    fixed, state = block[0].fixed, block[0].state
    belief = fixed.belief
    state.check.in_window = state.check.raised
    fl.free_offsets(belief, state.filter, fixed.limits.window)
    fl.clear_window(belief.size, state.acc)
    fl.believe_nuisances(belief, state.filter, state.acc, state.filter.time.last)
    state.counts.estimates = 1


def close_window(size, block, ring, profile):
    """Estimate from the window that closed, its last block being closed."""
    if size.structured == 1:
        choose_terms(block)
    solve_closed(block, ring, profile)
    if size.structured == 1:
        fl.limit_terms(block, profile)
    begin_next_window(block)


@kernel
def abandon_window(block):
    """The clock was set back: the window is given up and the next one begins."""
    fixed, state = block[0].fixed, block[0].state
    state.acc.counts.rows = 0
    state.filter.time.running = 0.0
    fl.clear_window(fixed.belief.size, state.acc)


@kernel
def follow_range(block, sigma, code):
    """Follow the range: its alarm after a block, the level at a window's end (`code`); none if the model is doubted."""
    fixed, state = block[0].fixed, block[0].state
    if state.check.raised == 0:
        total, watch, clock = state.bank.total, state.watch, state.clock
        watch_range(sigma, state.gauge, total, state.filter.time.last, clock.first, watch.counts, watch.event)
        if code == rb.WINDOW_COMPLETE:
            close_range(sigma, state.gauge, total, clock.closed + fixed.limits.window)


@kernel
def seal_block(block, rows, words, code):
    """All stays as it is until the next block; the status, or RECOVERED where memory is damaged."""
    fixed, state = block[0].fixed, block[0].state
    state.guard.carried = seal_carried(state, words, rows)
    if not fl.is_sound(fixed.belief.size, state.filter, state.bank.total):
        return gd.give_up(state.counts, code)
    state.guard.control = gd.seal_control(state.clock, state.counts)
    return code


# ---- the order


def process_samples(size, block, words, ring, seals, rows, profile, air, modes, known, shown, sigma, code):
    """Filter the samples that wait, close blocks and windows; return the Status, RECOVERED where memory is damaged."""
    if check_block(block, ring, seals, rows, words, code) == rb.RECOVERED:
        return rb.RECOVERED
    for _ in range(3 * TOGETHER):  # a block and a step at most for each sample that waits
        wanted = gather(block, ring, rows, profile, air, modes, known, shown, code)
        if wanted == SET_STEP:
            if size.servo > 0:
                sv.set_servo_step(block)
            if size.modes > 0:
                md.set_modes(block, modes)
        elif wanted != NOTHING:
            close_block(size, block, rows, profile)
        if wanted == NOTHING or wanted == CLOSE_LAST:
            break
    if code == rb.WINDOW_COMPLETE:
        close_window(size, block, ring, profile)
    elif code == rb.CLOCK_RESET:
        abandon_window(block)
    if size.ranged == 1:
        follow_range(block, sigma, code)
    return seal_block(block, rows, words, code)


def update_filtered(size, block, words, ring, seals, rows, profile, air, modes, known, shown, sigma, t, theta,
                    theta_dot, beta, theta_ddot, beta_cmd, gamma):
    """Take one sample; returns its Status.  RECOVERED: memory is damaged, the caller has to begin anew with it.

    size  how much of the memory is in use;  the rest as of the entries, in the order of `table.SEPARATE_ARRAYS`
    """
    code = push_sample(block, ring, seals, rows, t, theta, theta_dot, beta, theta_ddot, beta_cmd, gamma)
    if code >= rb.DUE:
        code = process_samples(size, block, words, ring, seals, rows, profile, air, modes, known, shown, sigma,
                               code - rb.DUE)
    return code


@kernel
def restart_filtered(block, rows, words):
    """Set what is not zero before the first sample."""
    fixed, state = block[0].fixed, block[0].state
    size, acc = fixed.belief.size, state.acc
    wn.clear_outcome(state.outcome, wn.SHORT)
    for k in range(size.levels):
        acc.level_information[k, k] = fixed.belief.prior[k]
    fl.clear_window(size, acc)
    for k in range(size.servo):
        state.filter.servo.r[k, k], state.filter.servo.root[k, k] = 1.0, 1.0
    if size.servo > 0:
        sv.believe_servo(fixed.belief, state.filter)
    if size.numbers > 0:
        md.restart_numbers(fixed.belief, state.filter.modes)
    for k in range(len(tr.MEMBERS)):
        state.bank.weight[k] = 1.0 / len(tr.MEMBERS)
    first = sx.FIRST_STD * sx.FIRST_STD
    tr.restart_bank(fixed.belief.slopes[:], state.bank, 0.0, 0.0, first, 0.0, first)
    if size.undeclared > 0:
        un.restart_undeclared(state.undeclared)
    for k in range(size.terms):
        state.active[k] = 1
        if size.structured == 1:
            state.learned[k, k] = PRIOR
    if size.ranged == 1:
        restart_gauge(state.gauge)
    state.guard.carried = seal_carried(state, words, rows)


@kernel
def report_now(block, profile, air, modes):
    """Fill work.report, all that leaves beside the outcome, as of the closed window's end or of a later last sample."""
    fixed, state, rep = block[0].fixed, block[0].state, block[0].work.report
    counts, clock = state.counts, state.clock
    is_later = counts.rows > counts.closed_back
    t = clock.last if is_later else clock.closed + fixed.limits.window
    contradicted = state.check.raised == 1
    rp.report_tracked(profile, state.bank.total, contradicted, t, rep)
    rp.report_air(fixed.belief, air, state.filter, state.bank.total, contradicted, rep)
    rp.report_servo(fixed.belief, state.filter, contradicted, rep)
    if modes is not None:
        rp.report_modes(fixed.belief, modes, state.filter, contradicted, t, rep)
    rp.report_changes(profile, state.watch, rep)
    for k in range(fixed.belief.size.levels):
        rep.noise[k] = exp_of(state.filter.level[k])
    rp.report_level(fixed.belief.size, state.gauge, rep)
