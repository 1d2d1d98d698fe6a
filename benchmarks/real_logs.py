"""The two measured pendulum logs: terms found, physical constants, held-out prediction, the held-out plot.

    python benchmarks/real_logs.py FOLDER [--plot PATH]

FOLDER holds dfki_pendulum_dircol.csv and dfki_pendulum_ddp.csv: swing-ups of the torque-limited simple pendulum of
DFKI-RIC (public repository dfki-ric-underactuated-lab/torque_limited_simple_pendulum, BSD-3), columns t, theta,
theta_dot, beta (torque reported), beta_cmd.  Fitted on the first 60 %, judged on the last 40 %: R^2 of the predicted
change of theta_dot over 0.1 s, the model integrated along the measured states.
"""

import argparse
from pathlib import Path

import numpy as np

from launchid.identification.windows import run, whole_log
from launchid.log.log import Log, read_log
from launchid_core import Config, Estimate

LOGS = ("dfki_pendulum_dircol.csv", "dfki_pendulum_ddp.csv")
LIBRARIES = {"linear in theta": "theta,beta,sign(theta_dot)", "sin(theta), no friction": "sin(theta),beta",
             "sin(theta), friction": "sin(theta),beta,sign(theta_dot)", "quadratic+sin": "quadratic+sin"}
FIT_SHARE = 0.6
HORIZON = 0.1            # s
GRAVITY = (20.3, 21.4)   # 1/s^2: m g l over the inertia, from the device's data


def fit(log: Log, library: str, share: float) -> Estimate:
    """One integral-form estimate of the first `share` of a log."""
    n = int(share * len(log.t))
    config = Config(**whole_log(n, log.period, log.t[0], log.t[n - 1]), library=library, formulation="integral")
    estimates, _ = run(config, (sample for k, sample in enumerate(log.samples()) if k < n))
    return estimates[0]


def acceleration(log: Log, estimate: Estimate) -> np.ndarray:
    """theta_ddot of the model along the measured states."""
    columns = {"1": np.ones_like(log.t), "theta": log.theta, "theta_dot": log.theta_dot, "beta": log.beta,
               "sin(theta)": np.sin(log.theta), "sign(theta_dot)": np.sign(log.theta_dot)}
    total = np.zeros_like(log.t)
    for term, coefficient in zip(estimate.terms, estimate.xi[:, 1], strict=True):
        value = np.ones_like(log.t)
        for factor in term.split("*"):
            name, _, power = factor.partition("^")
            value = value * columns[name] ** int(power or 1)
        total += coefficient * value
    return total


def held_out(log: Log, estimate: Estimate) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
    """R^2 on the last part, and (t, measured, predicted) changes of theta_dot over the horizon there."""
    begin, step = int(FIT_SHARE * len(log.t)), round(HORIZON / log.period)
    a = acceleration(log, estimate)
    integral = np.concatenate([[0.0], np.cumsum(0.5 * (a[1:] + a[:-1]) * np.diff(log.t))])
    rows = np.arange(begin, len(log.t) - step)
    measured = log.theta_dot[rows + step] - log.theta_dot[rows]
    predicted = integral[rows + step] - integral[rows]
    r2 = 1.0 - np.sum((measured - predicted) ** 2) / np.sum((measured - measured.mean()) ** 2)
    return float(r2), log.t[rows], measured, predicted


def plot(rows: list[tuple[str, np.ndarray, np.ndarray, np.ndarray]], path: str) -> None:
    """Measured and predicted change of theta_dot on the part that no coefficient was fitted to."""
    import matplotlib.pyplot as plt

    from launchid.figures.plots import save
    figure, axes = plt.subplots(len(rows), 1, figsize=(9, 2.6 * len(rows)))
    for axis, (title, t, measured, predicted) in zip(axes, rows, strict=True):
        axis.plot(t, measured, color="0.65", linewidth=2.5, label="measured")
        axis.plot(t, predicted, color="0.0", linewidth=0.9, label="predicted")
        axis.set_title(title, fontsize=9)
        axis.set_ylabel(f"change of theta_dot\nover {HORIZON:g} s [rad/s]", fontsize=8)
        axis.grid(True, color="0.88")
    axes[0].legend(fontsize=8)
    axes[-1].set_xlabel("t [s]")
    figure.tight_layout()
    save(figure, path)


def main() -> None:
    """Run and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--plot")
    args = parser.parse_args()
    drawn = []
    for name in LOGS:
        log = read_log(args.folder / name)
        for title, library in LIBRARIES.items():
            r2, t, measured, predicted = held_out(log, fit(log, library, FIT_SHARE))
            whole = fit(log, library, 1.0)
            active = [(term, whole.xi[j, 1]) for j, term in enumerate(whole.terms) if whole.support[j, 1]]
            print(f"{name:26} {title:24} held-out R^2 {r2:7.3f}   whole log: "
                  + ", ".join(f"{value:.4g} {term}" for term, value in active))
            if title == "sin(theta), friction":
                drawn.append((f"{name}: {title}, held-out R^2 = {r2:.3f}", t, measured, predicted))
    print(f"physical: coefficient of sin(theta) -{GRAVITY[0]} .. -{GRAVITY[1]} 1/s^2, "
          "of the torque 6.8 .. 7.2 1/(kg m^2)")
    if args.plot:
        plot(drawn, args.plot)


if __name__ == "__main__":
    main()
