"""Cramer-Rao bound: the least error that an unbiased estimator of a6 and k1 can have on a window of data.

Unknown: a constant relative deviation of a6 and of k1 from the nominal's profile
over the window, the vehicle's state at its start (diffuse), and what [wind] and
[offsets] leave open: the wind's walk and turbulence, misalignment, moment and
sensor offsets, at the window's start no better known than before the flight.
Of the actuator, the numbers with a sigma in [actuator] are unknown too: natural
frequency, damping ratio, delay.  Slosh and bending are two more states each, at the
window's start unknown; of their numbers those with a sigma.
Known: the command, the rest of the actuator, the flight path, and the levels of the noises
(sensor noise as measurement noise; command noise and unmodelled acceleration as
process noise, held over a sample), of wind and of offsets.

Method: prediction-error sensitivities through the exact Kalman filter about the
true parameters (Ljung, System Identification, 2nd ed., section 9.4, and Gupta &
Mehra, IEEE TAC 19, 1974), nuisances as states beside the vehicle's.  In calm air the
filter's own start does not matter: an unknown initial offset with a flat prior
added to any finite covariance is a diffuse start, so its four sensitivities join
the two of the parameters and a Schur complement removes them.

With such states the derivative of the filter's covariance for a6 and k1 is carried
too, and what it adds to the Fisher information counted: through the gain's derivative
in the sensitivities, and as tr(S^-1 dS S^-1 dS)/2.  It is first order: a constant
offset that is seen through a6 alone would otherwise seem to shift the angle of attack
while the filter learns it, an excitation that is not there (vega_like, attitude bias
unknown, 10 s: 4.0 % with it, 2.4 % without; greensite_cr826 7 and 3.6 %).

What the size of the wind's response tells of a6 counts only with `levels_known`.  The
wind enters as a6 w: known levels of w make of every gust a measurement of a6 (constant
nominal, 10 s: 9 % instead of 21 %), levels that are to be estimated do not, and so by
default it is the law of the acceleration a6 w that is known, at the true a6.

Limitation: in calm air the information in the innovations' covariance is left out; on
these vehicles it is below 0.1 %.

Files: `world` (states of wind, offsets, flight path), `modes` (slosh, bending), `step` (transition and noise of a
step), `information` (filter, sensitivities, Fisher information, bounds from it), `flights` (bounds of a nominal's
flights).
"""
