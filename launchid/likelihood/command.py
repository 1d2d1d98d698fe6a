"""What becomes of the commands on their way to the servo: play, lag, wash-out, rate limit; compiled."""

import math

from sim.kernels import kernel

from .kernel import FIRST_ORDER_SERVO


@kernel
def played(u, width, noise, out):
    """Write to out (m,) the mean of commands u (m,) [rad] behind a play of +-width, with white noise on each.

    The noise works its way through a play that is not far wider.  The driven side is a normal variable of mean y and
    variance v; d, what is asked of it, is one too, and moves it by what is beyond the play: by the means of that, its
    square and its product with d (Gelb and Vander Velde, Multiple-Input Describing Functions, 1968, ch. 7).
    """
    y, v = u[0], 0.0
    for i in range(len(u)):
        if noise == 0.0:
            y = min(max(y, u[i] - width), u[i] + width)
        else:
            s = math.sqrt(noise * noise + v)
            above, below = (u[i] - y - width) / s, (y - u[i] - width) / s
            pa, pb = 0.5 * math.erfc(-above / math.sqrt(2.0)), 0.5 * math.erfc(-below / math.sqrt(2.0))
            fa = math.exp(-0.5 * above * above) / math.sqrt(2.0 * math.pi)
            fb = math.exp(-0.5 * below * below) / math.sqrt(2.0 * math.pi)
            moved = s * (above * pa + fa - below * pb - fb)
            squares = s * s * ((1.0 + above * above) * pa + above * fa + (1.0 + below * below) * pb + below * fb)
            r = v / (s * s)                   # the driven side's own part of d
            y += moved
            v = r * noise * noise + max(squares - moved * moved - 2.0 * r * s * s * (pa + pb) + r * v, 0.0)
        out[i] = y


@kernel
def nozzle_input(u, h, numbers, lag, washout, rate, out):
    """Write to out (m,) the servo's input for commands u (m,), means over steps h (m,) [s]: behind a first-order lag,
    and less its low-pass of time 1/washout; of a servo that moves no faster than `rate`, the input at which the linear
    servo moves alike, by the trapezoidal rule, which gives u back where nothing is limited."""
    c, low, y = numbers[0], 0.0, u[0]
    b, v = u[0], 0.0
    w, z = c.frequency, c.damping_ratio
    for i in range(len(u)):
        x = u[i]
        if lag > 0.0:
            a = math.exp(-h[i] / lag)
            mean = x + (y - x) * (1.0 - a) * lag / h[i]
            y = x + (y - x) * a
            x = mean
        if washout > 0.0:
            a = math.exp(-h[i] * washout)
            mean = x + (low - x) * (1.0 - a) / (washout * h[i])
            low = x + (low - x) * a
            x = x - mean
        if rate > 0.0:
            m = max(1, math.ceil(w * h[i] / 0.1))
            g, total = h[i] / m, 0.0
            for _ in range(m):
                if c.servo == FIRST_ORDER_SERVO:
                    mid = min(max(w * (x - b) / (1.0 + 0.5 * g * w), -rate), rate)
                    total += mid / w
                else:
                    drag = g * w * (0.25 * g * w + z)
                    nv = (v * (1.0 - drag) + g * w * w * (x - b)) / (1.0 + drag)
                    nv = min(max(nv, -rate), rate)
                    mid = 0.5 * (nv + v)
                    total += 2.0 * z / w * mid + (nv - v) / g / (w * w)
                    v = nv
                total += b + 0.5 * g * mid
                b += g * mid
            x = total / m
        out[i] = x
